"""The RePlan loop: planners, perceiver, verifier, reasoner backends and replanning memory."""

from replan_base.moved import tell_where_modules_went

tell_where_modules_went()
