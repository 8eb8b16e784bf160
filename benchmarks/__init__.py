"""Measurements behind `replan bench`: each prints a table or JSON. Imports nothing from the tests."""
