"""Object library, cells, the digital twin, verdicts and diagnosis in it, rendering."""
