"""Pictures of random cells with their truth, for training and benchmarks of perception."""
