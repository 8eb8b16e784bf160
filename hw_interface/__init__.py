"""Messages, transport, driver and nodes between the stack and a robot cell, simulated or real."""

from replan_base.moved import tell_where_modules_went

tell_where_modules_went()
