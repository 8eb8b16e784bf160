#!/usr/bin/env bash
# Pinocchio reads capital letters of a MJCF eulerseq as small ones, though they mean the opposite order.
#
# Version: pin 4.1.0, mujoco 4.0.0, numpy 2.4.6, Python 3.11.
# Expected: "XYZ" turns about fixed axes and "xyz" about axes that move, as in MuJoCo; these are different orientations.
#   "XYZ" is what files that come from URDF use.
# Behaviour: both are read as "xyz". No error, no warning.
# Output (angle between the orientation of the two readers, for euler="0.3 0.5 0.7"):
#   xyz: 0.0 degrees
#   zyx: 0.0 degrees
#   XYZ: 23.9 degrees
#   ZYX: 23.9 degrees
# Remedy: write the sequence in the reverse order with small letters, or quaternions.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pin==4.1.0 mujoco==4.0.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import pathlib
import tempfile

import mujoco
import numpy as np
import pinocchio

text = """<mujoco><compiler angle="radian" eulerseq="{}"/><worldbody><body name="arm" euler="0.3 0.5 0.7">
<joint name="turn"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody></mujoco>"""


def difference(path):
    """Angle in degrees between the two orientations of the arm."""
    first = mujoco.MjModel.from_xml_path(path)
    second = pinocchio.buildModelFromMJCF(path)
    state, data = mujoco.MjData(first), second.createData()
    mujoco.mj_forward(first, state)
    pinocchio.framesForwardKinematics(second, data, np.zeros(1))
    one = data.oMf[second.getFrameId("arm", pinocchio.FrameType.BODY)].rotation
    turn = pinocchio.log3(one.T @ state.body("arm").xmat.reshape(3, 3))
    return round(float(np.degrees(np.linalg.norm(turn))), 1)


seen = {}
with tempfile.TemporaryDirectory() as folder:
    for sequence in ("xyz", "zyx", "XYZ", "ZYX"):
        file = pathlib.Path(folder, "arm.xml")
        file.write_text(text.format(sequence))
        seen[sequence] = difference(str(file))
for sequence, angle in seen.items():
    print(f"{sequence}: {angle} degrees")
expected = {"xyz": 0.0, "zyx": 0.0, "XYZ": 23.9, "ZYX": 23.9}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
