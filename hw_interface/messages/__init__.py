"""What is said between a cell and the rest, as strictly checked models, and their bytes. Imports no other room."""
