#!/usr/bin/env bash
# A centre of mass that is set in trimesh makes the moments of inertia smaller, down to negative ones.
#
# Version: trimesh 5.2.0, scipy 1.17.1, numpy 2.4.6, Python 3.11.
# Expected: moment_inertia is taken about mesh.center_mass, as its page says, so a centre beside the middle of a cube
#   gives more; and it does not depend on where the cube is.
# Behaviour: the setter takes measured centres of mass. The inertia about the origin is then moved to the new centre as
#   if that were the centre of the shape, which subtracts too much, and more the farther the mesh is from the origin.
# Output (moment about y of a cube of 1 kg, right value 0.1767 with the centre 0.1 m beside the middle):
#   not set: 0.1667
#   set, cube at the origin: 0.1567
#   set, cube 2 m from the origin: -0.2433
# Remedy: take mass and inertia without setting a centre, and move them by hand.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check trimesh==5.2.0 scipy==1.17.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import trimesh


def moment(place, aside):
    """Moment about y of a cube at x = place, with the centre of mass set aside or not set."""
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    box.apply_translation([place, 0.0, 0.0])
    if aside:
        box.center_mass = [place + aside, 0.0, 0.0]
    return round(float(box.moment_inertia[1, 1]), 4)


seen = {
    "not set": moment(2.0, 0.0),
    "set, cube at the origin": moment(0.0, 0.1),
    "set, cube 2 m from the origin": moment(2.0, 0.1),
}
for name, what in seen.items():
    print(f"{name}: {what}")
raise SystemExit(0 if list(seen.values()) == [0.1667, 0.1567, -0.2433] else "the behaviour has changed")
PYTHON
