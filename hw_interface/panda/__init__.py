"""A real Panda: a supervisor that owns the right to move, and a player that talks to the control box."""
