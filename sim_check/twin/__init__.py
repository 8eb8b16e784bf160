"""The digital twin: what the stack believes, set down on its supports. Reads nothing of a cell's truth."""
