"""The RePlan loop: task, subtask, skill, with perceiver, verifier and diagnosis. May import all but `baselines`."""
