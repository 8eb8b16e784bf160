"""The 2F-85 with fingers that go along the arc of the real linkage, for tests of what linear jaws leave out."""

import mujoco
import numpy as np
import pytest

from control.twin_model import FINGER_BODIES, FINGER_JOINTS, TwinModel
from sim_check.models import panda_mjcf, robotiq_mjcf
from sim_check.twin import twin

LINK, PAD, AXIS = 0.05715, 0.0078, 0.0127  # [m]: ROS-Industrial's description of it


def drawn_back(half: np.ndarray) -> np.ndarray:
    """How far the tips are behind their furthest reach in [m], at half of the distance between the pads in [m]."""
    return LINK - np.sqrt(LINK**2 - (half + PAD - AXIS) ** 2)


def use_arc_fingers(monkeypatch: pytest.MonkeyPatch, opening: float) -> None:
    """Twins that are built from now on have them: each finger slides back as it opens."""
    half = np.linspace(0.0, opening / 2, 100)
    # MuJoCo couples joints by polynomials of fourth order: here good to 0.02 mm.
    fitted = np.polynomial.Polynomial.fit(half, drawn_back(half), 4).convert().coef
    linear, pose_robot = robotiq_mjcf.add_robotiq, twin._robot_qpos

    def add_arc_fingers(spec: mujoco.MjSpec, *arguments):
        joints = linear(spec, *arguments)
        for body, finger in zip(FINGER_BODIES, FINGER_JOINTS, strict=True):
            spec.body(body).add_joint(
                name=f"{finger}_arc",
                type=mujoco.mjtJoint.mjJNT_SLIDE,
                axis=[0.0, 0.0, -1.0],
                armature=panda_mjcf.FINGER_ARMATURE,
                damping=[panda_mjcf.FINGER_DAMPING, 0.0, 0.0],
            )
            coupling = spec.add_equality(
                name=f"{finger}_arc", type=mujoco.mjtEq.mjEQ_JOINT, name1=f"{finger}_arc", name2=finger
            )
            coupling.data[:5] = fitted
            coupling.solref = [0.005, 1.0]
        return joints

    def pose_arc_robot(model: TwinModel, qpos: np.ndarray, width: float) -> np.ndarray:
        qpos = pose_robot(model, qpos, width)
        for finger in FINGER_JOINTS:
            qpos[model.model.joint(f"{finger}_arc").qposadr[0]] = drawn_back(np.array(min(width, opening) / 2))
        return qpos

    monkeypatch.setattr(panda_mjcf, "add_robotiq", add_arc_fingers)
    monkeypatch.setattr(twin, "_robot_qpos", pose_arc_robot)
