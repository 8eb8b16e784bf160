"""Motion search, planners and retiming, measured."""
