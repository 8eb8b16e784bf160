"""One text template per prompt contract, and the table of the contracts."""
