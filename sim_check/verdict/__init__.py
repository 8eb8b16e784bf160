"""The verdict on a retimed trajectory: replays in perturbed twins, held against every check. May import `twin`."""
