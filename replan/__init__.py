"""The `replan` command: configuration, runs and their records, reports, benchmarks."""
