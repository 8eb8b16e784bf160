"""Both sides of a cell: client, node, robot state machine, gate, motion monitor, audit. May import `link`."""
