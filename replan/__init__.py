"""The `replan` command: configuration, runs and their records, reports, benchmarks."""

from replan_base.moved import tell_where_modules_went

tell_where_modules_went()
