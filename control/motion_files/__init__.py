"""Motions in files of every format, read into trajectories or paths and back. May import `retiming` and below."""
