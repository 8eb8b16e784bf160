#!/usr/bin/env bash
# evo pairs several poses of a trajectory with the same pose of the other one.
#
# Version: evo 1.38.1, Python 3.11.
# Expected: each pose is used once, as with the association script of the TUM RGB-D benchmark, which removes both
#   partners.
# Behaviour: every pose of the shorter trajectory takes its nearest partner. A burst of three poses within 10 ms of one
#   pose of the reference is three pairs, and weighs three times in alignment and error.
# Output:
#   pairs: 0.000-0.003 0.004-0.003 0.008-0.003 1.000-1.001
#   different partners: 2 of 4
# Remedy: thin trajectories to the rate of the reference first, or count different partners.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check evo==1.38.1
"$folder/venv/bin/python" - <<'PYTHON'
import numpy as np
from evo.core.sync import associate_trajectories
from evo.core.trajectory import PoseTrajectory3D


def trajectory(stamps):
    """A trajectory along x at these times, without turning."""
    stamps = np.array(stamps)
    positions = np.column_stack((stamps, 0.0 * stamps, 0.0 * stamps))
    return PoseTrajectory3D(positions, np.tile([1.0, 0.0, 0.0, 0.0], (len(stamps), 1)), stamps)


short = trajectory([0.0, 0.004, 0.008, 1.0])
long = trajectory([0.003, 1.001, 2.0, 3.0, 4.0])
one, other = associate_trajectories(short, long, max_diff=0.01)
print("pairs:", " ".join(f"{a:.3f}-{b:.3f}" for a, b in zip(one.timestamps, other.timestamps)))
different = len(set(other.timestamps))
print(f"different partners: {different} of {len(other.timestamps)}")
raise SystemExit(0 if (different, len(other.timestamps)) == (2, 4) else "the behaviour has changed")
PYTHON
