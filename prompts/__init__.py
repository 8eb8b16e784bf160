"""One text template per prompt contract, and the table of the contracts."""

from replan_base.moved import tell_where_modules_went

tell_where_modules_went()
