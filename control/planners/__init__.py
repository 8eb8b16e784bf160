"""Finding a motion for one subtask: structured candidates, rollouts, choice; and the sampling baseline. On top."""
