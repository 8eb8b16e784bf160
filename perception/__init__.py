"""From RGB-D frames to named object poses. Imports none of the other folders."""

from replan_base.moved import tell_where_modules_went

tell_where_modules_went()
