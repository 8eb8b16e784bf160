"""Object library, cells, the digital twin, verdicts and diagnosis in it, rendering."""

from replan_base.moved import tell_where_modules_went

tell_where_modules_went()
