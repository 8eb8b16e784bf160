"""Which configurations and paths are free of collision: filter, planning context, RRT-connect. May import `tasks`."""
