"""Issuing and verifying certificates. Needs numpy only, so a robot-side process can verify.

The side that judged a trajectory issues; the side that would play it verifies, with its own clock, its own limits and
its own list of serials that were already used. Verification says nothing about the samples themselves: whoever plays
them holds them against its limits again (`control.safety.trajectory_checks`).
"""

import hashlib
import uuid
from collections.abc import Collection
from dataclasses import fields, is_dataclass

import numpy as np

from control.errors import RefusedError, TrajectoryError
from control.robot.gripper import PANDA_HAND, GripperModel
from control.robot.limits import RobotLimits
from control.safety.certificate import Certificate, Verdict
from control.safety.limits import SafetyLimits
from control.trajectory.samples import Trajectory

LIFETIME = 120.0  # [s]
START_TOLERANCE = 1e-4  # [rad]: the first sample must be what the robot is commanded to hold, up to rounding in transit
CLOCK_SLACK = 0.5  # [s] by which a certificate may seem to come from the future: two reads of clocks kept by NTP


def limits_hash(limits: RobotLimits, safety: SafetyLimits, gripper: GripperModel = PANDA_HAND) -> str:
    """SHA-256 over every number of these tables, so that a motion judged by other limits can be told apart."""
    digest = hashlib.sha256()
    for table in (limits, safety, gripper):
        digest.update(type(table).__name__.encode() + b"\n")
        for field in sorted(fields(table), key=lambda f: f.name):
            digest.update(f"{field.name}={_canonical(getattr(table, field.name))}\n".encode())
    return digest.hexdigest()


def _canonical(value: object) -> str:
    """Text that is equal exactly when the values are: numbers by their bits, arrays and tuples alike."""
    if value is None or isinstance(value, str):
        return repr(value)
    if is_dataclass(value):
        return _canonical(tuple(getattr(value, f.name) for f in fields(value)))
    if isinstance(value, np.ndarray | tuple | list):
        return "[" + ",".join(_canonical(v) for v in value) + "]"
    return float(value).hex()  # type: ignore[arg-type]


def issue_certificate(
    trajectory: Trajectory,
    verdict: Verdict,
    *,
    profile: str,
    firmware: str,
    limits_hash: str,
    scene_stamp: float,
    now: float,
    lifetime: float = LIFETIME,
    serial: str | None = None,
) -> Certificate:
    """The right to play a trajectory once, given that it passed.

    Args:
        trajectory: Exactly the samples that were judged.
        verdict: Judgement of them.
        profile: Robot profile whose limits were checked.
        firmware: Firmware family that those limits belong to.
        limits_hash: `limits_hash` of the limits that were checked.
        scene_stamp: Time in [s] of the frame that the twin was built from, on the robot's clock.
        now: Time in [s] on the robot's clock.
        lifetime: Time in [s] after which it expires.
        serial: Unique name; a random one unless told.

    Raises:
        TrajectoryError: The verdict did not pass, or a time is not valid.
    """
    failed = verdict.failed_checks
    if not verdict.passed or failed:
        why = "; ".join(f"{c.name} {c.worst:.4g} {c.unit} (limit {c.limit:.4g})" for c in failed)
        why = why or f"it succeeded in {verdict.successes} of {verdict.trials} perturbed twins only"
        raise TrajectoryError(f"no certificate for a trajectory that did not pass: {why}; plan another motion")
    if not (np.isfinite(now) and np.isfinite(scene_stamp) and scene_stamp <= now + CLOCK_SLACK):
        raise TrajectoryError(
            f"no certificate: the scene is of {scene_stamp} s and it is {now} s; a frame cannot be newer than now, so "
            "take both times from the robot's clock"
        )
    if not (np.isfinite(lifetime) and lifetime > 0):
        raise TrajectoryError(f"a certificate's lifetime is {lifetime} s; it must be a number above 0")
    return Certificate(
        serial=serial or uuid.uuid4().hex,
        trajectory_hash=trajectory.content_hash(),
        profile=profile,
        firmware=firmware,
        scene_stamp=float(scene_stamp),
        limits_hash=limits_hash,
        issued=float(now),
        expires=float(now) + lifetime,
    )


def verify_certificate(
    certificate: Certificate | None,
    trajectory: Trajectory,
    profile: str,
    firmware: str,
    limits_hash: str,
    now: float,
    used_serials: Collection[str],
    q_d: np.ndarray,
    max_scene_age: float,
) -> None:
    """Refuse to play a trajectory unless its certificate is for it, for this robot, and for now.

    Args:
        certificate: What came with the trajectory, or None.
        trajectory: What would be played.
        profile: Profile of this robot.
        firmware: Firmware family of this robot.
        limits_hash: `limits_hash` of this robot's own limits.
        now: Time in [s] on this robot's clock.
        used_serials: Serials that were accepted before; the caller adds this one when it accepts.
        q_d: Joint positions that the robot is commanded to hold in [rad], shape (7,).
        max_scene_age: Oldest frame in [s] that a motion may have been judged on.

    Raises:
        RefusedError: With code no_certificate, trajectory_changed, wrong_profile, wrong_firmware, wrong_limits,
            certificate_used, certificate_from_future, certificate_expired, scene_too_old or start_mismatch; the first
            that applies, in this order.
    """
    if certificate is None:
        raise RefusedError(
            "no_certificate",
            "the trajectory came without a certificate; have it judged in the twin, which issues one when it passes",
        )
    sent = trajectory.content_hash()
    if certificate.trajectory_hash != sent:
        raise RefusedError(
            "trajectory_changed",
            f"the trajectory is not the one that was judged: its hash is {sent[:12]}, the certificate is for "
            f"{certificate.trajectory_hash[:12]}; send exactly the samples that passed, or have these judged",
        )
    if certificate.profile != profile:
        raise RefusedError(
            "wrong_profile",
            f"the certificate is for a robot of profile '{certificate.profile}', this one is '{profile}'; have the "
            "trajectory judged with this robot's limits",
        )
    if certificate.firmware != firmware:
        raise RefusedError(
            "wrong_firmware",
            f"the certificate is for firmware '{certificate.firmware}', this robot runs '{firmware}', which enforces "
            "limits of its own; have the trajectory judged with the limits of this robot's firmware",
        )
    if certificate.limits_hash != limits_hash:
        raise RefusedError(
            "wrong_limits",
            f"the trajectory was judged by other limits ({certificate.limits_hash[:12]}) than this robot's "
            f"({limits_hash[:12]}); use the same cell file on both sides and have it judged again",
        )
    if certificate.serial in used_serials:
        raise RefusedError(
            "certificate_used",
            f"certificate {certificate.serial[:12]} was used already, and a certificate is good for one motion; look "
            "again and plan from what is seen",
        )
    _verify_times(certificate, now, max_scene_age)
    _verify_start(trajectory, q_d)


def _verify_times(certificate: Certificate, now: float, max_scene_age: float) -> None:
    """Compare so that a time which is not a number is refused, too."""
    for what, time in (
        ("certificate", certificate.issued),
        ("scene that the motion was judged on", certificate.scene_stamp),
    ):
        if not time <= now + CLOCK_SLACK:
            raise RefusedError(
                "certificate_from_future",
                f"the {what} is {time - now:.1f} s ahead of this robot's clock; take times from the robot's states and "
                "frames, or set the clocks",
            )
    if not now <= certificate.expires:
        raise RefusedError(
            "certificate_expired",
            f"the certificate expired {now - certificate.expires:.1f} s ago; it was good for "
            f"{certificate.expires - certificate.issued:.0f} s. Look again and plan from what is seen",
        )
    age = now - certificate.scene_stamp
    if not age <= max_scene_age:
        raise RefusedError(
            "scene_too_old",
            f"the motion was judged on a frame that is {age:.1f} s old; this robot takes at most {max_scene_age:g} s. "
            "Look again and plan from what is seen",
        )


def _verify_start(trajectory: Trajectory, q_d: np.ndarray) -> None:
    start = trajectory.q[0]
    held = np.asarray(q_d, dtype=float)
    if held.shape != start.shape:
        raise RefusedError("start_mismatch", f"the robot holds joints of shape {held.shape}, not {start.shape}")
    difference = np.abs(held - start)
    if not np.all(difference <= START_TOLERANCE):
        joint = int(np.argmax(np.where(np.isfinite(difference), difference, np.inf)))
        raise RefusedError(
            "start_mismatch",
            f"the trajectory does not begin where the arm is: {trajectory.joint_names[joint]} starts at "
            f"{start[joint]:.5f} rad, the robot holds {held[joint]:.5f} rad ({difference[joint]:.5f} rad apart, "
            f"{START_TOLERANCE} rad is allowed); plan again from the present state",
        )
