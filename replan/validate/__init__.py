"""Validating one motion in the twin: options, verdict, text, page, certificate."""
