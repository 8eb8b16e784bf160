"""The simulated cell's truth. Only the simulated cell and its scorers import this room."""
