"""Robot model, reward terms, motion search, retiming, trajectories and their checks. Imports no other folder."""
