#!/usr/bin/env bash
# Interpolating between two quaternions of pyquaternion changes the sign of the first one.
#
# Version: pyquaternion 0.9.9, numpy 2.4.6, Python 3.11.
# Expected: slerp leaves its arguments as they are. Its page says that they are normalized, which does nothing to unit
#   quaternions.
# Behaviour: where the scalar product is negative, the first argument itself is negated, to go the short way. It is the
#   same rotation, but another number: it no longer equals its copy, and differences of neighbours in a list jump.
# Output:
#   before: 0.98 0.00 0.00 0.20, equal to its copy True
#   after: -0.98 0.00 0.00 -0.20, equal to its copy False
# Remedy: hand slerp a copy, Quaternion(first).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pyquaternion==0.9.9 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import math

from pyquaternion import Quaternion


def described():
    """The four numbers, and whether they are still those of the copy."""
    numbers = " ".join(f"{number + 0.0:.2f}" for number in first.elements)
    return f"{numbers}, equal to its copy {first == copy}"


first = Quaternion(math.cos(0.2), 0.0, 0.0, math.sin(0.2))
second = Quaternion(-math.cos(0.3), 0.0, 0.0, -math.sin(0.3))
copy = Quaternion(first)
before = described()
Quaternion.slerp(first, second, 0.5)
after = described()
print(f"before: {before}")
print(f"after: {after}")
expected = "0.98 0.00 0.00 0.20, equal to its copy True", "-0.98 0.00 0.00 -0.20, equal to its copy False"
raise SystemExit(0 if (before, after) == expected else "the behaviour has changed")
PYTHON
