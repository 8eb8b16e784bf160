"""Verdicts and certificates: what a robot demands before it plays a trajectory. Needs numpy only.

A certificate is bound by a hash to exactly one trajectory. It guards against mistakes (a changed sample, a stale
scene, a repeated send), not against somebody who forges one on purpose.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class CheckResult:
    """One safety check over one motion.

    Attributes:
        name: Name in the safety table, for instance "hand_speed".
        worst: Worst value met, in `unit`.
        limit: The limit that it is held against, in `unit`.
        unit: For instance "m/s".
        at: Time of the worst value in [s] from the start, or None where time has no meaning.
        bodies: Names of the bodies involved, may be empty.
        ok: Whether the limit is kept.
    """

    name: str
    worst: float
    limit: float
    unit: str
    ok: bool
    at: float | None = None
    bodies: tuple[str, ...] = ()


@dataclass(frozen=True)
class Verdict:
    """Judgement of one retimed trajectory in the twin.

    Attributes:
        checks: Every safety check in the nominal twin.
        successes, trials: How many perturbed twins ended with the primary reward met and every check kept.
        interval: 95 % Wilson confidence interval of the success rate, (low, high).
        passed: All checks kept in the nominal twin and the success rate is high enough.
        steps: Simulated steps spent on the judgement.
    """

    checks: tuple[CheckResult, ...]
    successes: int
    trials: int
    interval: tuple[float, float]
    passed: bool
    steps: int

    @property
    def failed_checks(self) -> tuple[CheckResult, ...]:
        """Checks that are not kept."""
        return tuple(c for c in self.checks if not c.ok)


@dataclass(frozen=True)
class Certificate:
    """The right to play one trajectory once.

    Attributes:
        serial: Unique; a driver plays each serial once.
        trajectory_hash: `Trajectory.content_hash` of exactly these samples.
        profile: Robot profile that the limits belong to, for instance "panda/5".
        firmware: Family of robot system versions that the limits belong to (`RobotLimits.firmware`).
        scene_stamp: Time in [s] (robot's clock) of the frame that the twin was built from.
        limits_hash: Hash of the safety limits and robot limits that were checked.
        issued, expires: Times in [s] on the robot's clock.
    """

    serial: str
    trajectory_hash: str
    profile: str
    firmware: str
    scene_stamp: float
    limits_hash: str
    issued: float
    expires: float
