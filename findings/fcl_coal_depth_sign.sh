#!/usr/bin/env bash
# The penetration depth of a contact is positive in FCL and negative in coal, which comes from FCL.
#
# Version: python-fcl 0.7.0.11, coal 3.0.3, numpy 2.4.6, Python 3.11.
# Expected: coal has been FCL's fork with the same names; "penetration_depth" of two balls that overlap by half a metre
#   is 0.5 in both.
# Behaviour: coal's number is a signed distance, so the depth is negative, though its name has stayed. A threshold such
#   as "deeper than 1 cm", moved from one to the other, is never met or always. The normals agree.
# Output (two balls of radius 1, 1.5 m apart):
#   FCL: penetration_depth 0.5, normal [1.0, 0.0, 0.0]
#   coal: penetration_depth -0.5, normal [1.0, 0.0, 0.0]
# Remedy: compare abs(penetration_depth), and test the sign once at the start.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check python-fcl==0.7.0.11 coal==3.0.3 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import coal
import fcl
import numpy as np

far = np.array([1.5, 0.0, 0.0])
result = fcl.CollisionResult()
fcl.collide(
    fcl.CollisionObject(fcl.Sphere(1.0), fcl.Transform()),
    fcl.CollisionObject(fcl.Sphere(1.0), fcl.Transform(far)),
    fcl.CollisionRequest(enable_contact=True),
    result,
)
other = coal.CollisionResult()
coal.collide(
    coal.Sphere(1.0),
    coal.Transform3s.Identity(),
    coal.Sphere(1.0),
    coal.Transform3s(np.eye(3), far),
    coal.CollisionRequest(coal.CollisionRequestFlag.CONTACT, 1),
    other,
)
seen = {
    name: (round(contact.penetration_depth, 6), np.round(contact.normal, 6).tolist())
    for name, contact in (("FCL", result.contacts[0]), ("coal", other.getContact(0)))
}
for name, (depth, normal) in seen.items():
    print(f"{name}: penetration_depth {depth}, normal {normal}")
axis = [1.0, 0.0, 0.0]
raise SystemExit(0 if seen == {"FCL": (0.5, axis), "coal": (-0.5, axis)} else "the behaviour has changed")
PYTHON
