"""The right to play a motion that passed: what a certificate from `replan validate` needs beyond a verdict."""

import time
from pathlib import Path

from control.errors import ConfigError
from control.safety.certificate import Certificate
from control.safety.certification import issue_certificate, limits_hash
from replan.validate.motion import Validation

LEAST_TWINS = 6  # as many as a run tries its own motions in


def check_outputs(certificate: Path | None, saved: Path | None, perturbed: int) -> None:
    """Refuse a certificate that nothing could be played with, or that would rest on too little, before any work.

    Args:
        certificate: Where it is to be written, or None.
        saved: Where the samples are to be written, or None.
        perturbed: In how many perturbed twins the motion is tried.

    Raises:
        ConfigError: There is a certificate, but no file of its samples or too few perturbed twins.
    """
    if certificate is None:
        return
    if saved is None:
        raise ConfigError(
            "a certificate is for exactly the samples that were judged; say where they go, too: --save NAME.npz"
        )
    if perturbed < LEAST_TWINS:
        raise ConfigError(f"no certificate from {perturbed} perturbed twins; let it be tried in {LEAST_TWINS} or more")


def certificate_of(validation: Validation, lifetime: float) -> Certificate:
    """A certificate for a motion that passed.

    Poses that a person wrote down count as seen when they were read: whoever asks for the certificate vouches for them.

    Args:
        validation: What passed.
        lifetime: In [s].

    Raises:
        TrajectoryError: It did not pass, or the lifetime is not valid.
    """
    v = validation
    return issue_certificate(
        v.trajectory,
        v.verdict,
        profile=v.limits.profile,
        firmware=v.limits.firmware,
        limits_hash=limits_hash(v.limits, v.safety, v.cell.robot.gripper_model),
        scene_stamp=v.scene.stamp,
        now=time.time(),
        lifetime=lifetime,
    )
