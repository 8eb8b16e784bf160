"""Every safety residual in one typed table: what it is, its unit and limit, and which stage judges it.

The limits come from where they are used: the residuals of a twin's motion (`control.safety.residuals`), the safety
table's numbers (`control.safety.limits`), the robot's published limits (`control.robot.limits`). Reports and
docs/safety.md print this.

    python -m control.safety.table
"""

from dataclasses import dataclass
from typing import Literal

from control.robot.limits import RobotLimits, panda_limits
from control.safety.limits import SafetyLimits
from control.safety.residuals import safety_residuals
from control.safety.swept_volume import UNIT
from control.safety.trajectory_checks import REST_ACCELERATION, REST_SPEED

Stage = Literal["samples", "twin", "replay", "verdict", "looks"]
STAGES: dict[str, str] = {
    "samples": "every 1 kHz sample of the trajectory, by the verdict and again by the driver",
    "twin": "the motion as it goes in the twin: as cost and check in the search, in the verdict's nominal twin and in "
    "every perturbed one",
    "replay": "the retimed trajectory replayed in the twin, by the verdict; the search keeps to it geometrically",
    "verdict": "the verdict, in the nominal twin and, of the reward, in every perturbed one",
    "looks": "the verdict, in the nominal twin, where cameras have looked; `replan validate` looks through none",
}


@dataclass(frozen=True)
class SafetyRow:
    """One residual.

    Attributes:
        name: As in verdicts and failures.
        meaning: What is measured.
        unit: Of value and limit.
        limit: Of each joint where they differ, else one number.
        least: Whether the value must not fall below the limit; otherwise it must not exceed it.
        stage: Who judges it, a key of `STAGES`.
    """

    name: str
    meaning: str
    unit: str
    limit: tuple[float, ...]
    least: bool
    stage: Stage


_TWIN: dict[str, tuple[Stage, str]] = {
    "tracked_hand_speed": ("replay", "speed of the tool centre point as the twin's arm moves, over 20 ms"),
    "tracked_hand_angular_speed": ("replay", "angular speed of the hand as the twin's arm moves, over 20 ms"),
    "contact_force": ("twin", "force on arm or hand, fingers apart, from anything but the robot"),
    "pressing_force": ("replay", "force on fingers or handled object from anything that is neither"),
    "unwanted_contact": ("twin", "force of a contact outside fingers, handled object and its supports"),
    "self_contact": ("twin", "force between two parts of the robot, the two fingers apart"),
    "workspace": ("twin", "distance of any point of hand or fingers outside the workspace box"),
    "keep_out": ("twin", "depth of any moving part of the robot inside a keep-out zone"),
    "moved": ("twin", "displacement of an object that the subtask does not name"),
    "joint_moved": ("twin", "displacement of the handle of a joint that the subtask does not name"),
    "tipped": ("twin", "tilt of an object that the subtask does not name"),
    "self_clearance": ("replay", "distance lacking between parts of the robot that are not neighbours"),
    "arm_clearance": ("replay", "distance lacking between arm or hand and the world"),
    "finger_clearance": ("replay", "distance lacking between fingers and what they do not handle"),
    "held_clearance": ("replay", "distance lacking between a carried object and the world, in transit"),
    "held_kept": ("twin", "slip of a held object in the hand"),
    "released": ("twin", "force between robot and object at the end, where it has to be let go"),
    "settled": ("twin", "speed of any object or handle over the last {settle_time:g} s"),
}
# A clearance's residual is what lacks of it; people want to read the clearance itself.
_CLEARANCES = ("self_clearance", "arm_clearance", "finger_clearance", "held_clearance")


def safety_table(safety: SafetyLimits | None = None, limits: RobotLimits | None = None) -> tuple[SafetyRow, ...]:
    """All residuals, with the numbers of one cell and one robot.

    Args:
        safety: The cell's table; the defaults if None.
        limits: Published limits of the robot; the Panda's if None.
    """
    safety, limits = safety or SafetyLimits(), limits or panda_limits()
    speed, acceleration = safety.velocity_scale, safety.acceleration_scale
    ends = "" if limits.velocity_ends is None else ", which is lower near the ends of a joint"
    rest = f"acceleration {REST_ACCELERATION:g} rad/s^2"
    samples: tuple[tuple[str, str, str, tuple[float, ...]], ...] = (
        ("joint_position", "distance to the nearest position limit", "rad", (safety.joint_margin,)),
        ("joint_velocity", f"{speed:.0%} of the published limit{ends}", "rad/s", tuple(limits.qd * speed)),
        (
            "joint_acceleration",
            f"{acceleration:.0%} of the published acceleration",
            "rad/s^2",
            tuple(limits.qdd * acceleration),
        ),
        ("joint_jerk", "third difference of the positions", "rad/s^3", tuple(limits.qddd)),
        ("torque", "joint torque by the rigid-body model", "Nm", tuple(limits.tau)),
        ("torque_rate", "change of the joint torque per second", "Nm/s", tuple(limits.taud)),
        (
            "hand_speed",
            "commanded speed of the tool centre point",
            "m/s",
            (min(safety.hand_speed, limits.cartesian_speed),),
        ),
        (
            "hand_angular_speed",
            "commanded angular speed of the hand",
            "rad/s",
            (min(safety.hand_angular_speed, limits.angular_speed),),
        ),
        (
            "hand_acceleration",
            f"commanded acceleration of the tool centre point, {acceleration:.0%} of the published limit",
            "m/s^2",
            (limits.cartesian_acceleration * acceleration,),
        ),
        (
            "hand_angular_acceleration",
            f"commanded angular acceleration of the hand, {acceleration:.0%} of the published limit",
            "rad/s^2",
            (limits.angular_acceleration * acceleration,),
        ),
        ("hand_jerk", "commanded jerk of the tool centre point", "m/s^3", (limits.cartesian_jerk,)),
        ("hand_angular_jerk", "commanded angular jerk of the hand", "rad/s^3", (limits.angular_jerk,)),
        ("starts_at_rest", f"speed of the first sample; {rest}", "rad/s", (REST_SPEED,)),
        ("ends_at_rest", f"speed of the last sample; {rest}", "rad/s", (REST_SPEED,)),
        ("sampled_consistently", "difference of the derivatives from those of q", "of the allowed difference", (1.0,)),
    )
    rows = [SafetyRow(n, m, unit, limit, n == "joint_position", "samples") for n, m, unit, limit in samples]
    meaning = "largest difference of a joint between the first sample and the robot"
    rows.append(SafetyRow("start_state", meaning, "rad", (safety.start_tolerance,), False, "verdict"))
    for residual in safety_residuals(safety):
        stage, text = _TWIN[residual.name]
        meaning = text.format(settle_time=safety.settle_time)
        if residual.name in _CLEARANCES:
            meaning += f"; {getattr(safety, residual.name) * 1e3:g} mm are asked for"
        rows.append(SafetyRow(residual.name, meaning, residual.unit, (residual.limit,), False, stage))
    meaning = f"what a reward term lacks at its worst over the last {safety.settle_time:g} s"
    rows.append(SafetyRow("reward_met", meaning, "m", (0.0,), False, "verdict"))
    refused = safety.unseen == "refuse"
    for name, what in (
        ("unseen_volume", "share of the swept volume that nobody saw and where something that stands could be"),
        ("unseen_overhead", "share of the swept volume that nobody saw above space that was seen to be free"),
    ):
        most = getattr(safety, name)
        meaning = what if refused else f"{what}; judged where a cell says `unseen: refuse`, then at most {most:g}"
        rows.append(SafetyRow(name, meaning, UNIT, (most if refused else 1.0,), False, "looks"))
    return tuple(rows)


def as_markdown(rows: tuple[SafetyRow, ...]) -> str:
    """The table as it stands in docs/safety.md."""
    lines = ["| residual | what it is | limit | judged on |", "|---|---|---|---|"]
    for row in rows:
        numbers = list(dict.fromkeys(f"{x:g}" for x in row.limit))
        values = numbers[0] if len(numbers) == 1 else ", ".join(f"{x:g}" for x in row.limit)
        sign = "at least" if row.least else "at most"
        lines.append(f"| `{row.name}` | {row.meaning} | {sign} {values} {row.unit} | {row.stage} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(as_markdown(safety_table()))
