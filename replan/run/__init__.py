"""A run from a typed goal to a judged result, and its record."""
