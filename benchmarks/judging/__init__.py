"""Verdicts and diagnoses against injected faults and causes."""
