"""Whole runs on goals in other words."""
