"""Robot model, reward terms, motion search, retiming, trajectories and their checks. Imports no other folder."""

from replan_base.moved import tell_where_modules_went

tell_where_modules_went()
