"""From RGB-D frames to named object poses. Imports none of the other folders."""
