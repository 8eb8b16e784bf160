"""The 1 kHz trajectory, and how its clock is slowed, stopped or overridden on its path. May import `robot`."""
