"""Playing one trajectory with its certificate: nothing is looked at, planned or judged here; the robot decides."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from control.errors import StoppedError
from control.safety.certificate import Certificate
from control.trajectory.samples import SAMPLE_TIME, Trajectory
from hw_interface.cell.client import CellClient, MotionProgress
from hw_interface.link.security import LinkSecurity

SHARES_TOLD = 10  # lines of progress in a motion


@dataclass(frozen=True)
class PlayReport:
    """How a motion was played.

    Attributes:
        serial: Of its certificate, which is used up now.
        samples: Of the trajectory, all played.
        seconds: Robot time that it took in [s].
        slowest, fastest: Shares of the certified speed that it was played at while it moved.
        max_tracking_error: Largest difference per joint between commanded and measured position in [rad].
    """

    serial: str
    samples: int
    seconds: float
    slowest: float
    fastest: float
    max_tracking_error: float

    def as_json(self) -> dict[str, Any]:
        """As one JSON object."""
        return asdict(self)

    def as_text(self) -> str:
        """For people."""
        speed = f"{self.fastest:g}" if self.slowest == self.fastest else f"{self.slowest:.2g} to {self.fastest:.2g}"
        return (
            f"played: {self.samples} samples in {self.seconds:.1f} s at speed {speed}, "
            f"followed within {self.max_tracking_error:.4f} rad"
        )


def play(
    trajectory: Trajectory,
    certificate: Certificate | None,
    endpoint: str,
    say: Callable[[str], None],
    speed: float | None = None,
    security: LinkSecurity | None = None,
) -> PlayReport:
    """Send a robot exactly this trajectory with this certificate, and wait until the arm rests again.

    Ctrl-C brings the arm to rest on its path before KeyboardInterrupt is raised.

    Args:
        trajectory: What to play.
        certificate: The right to play it once.
        endpoint: Of the robot process.
        say: Progress for people, one line a call.
        speed: Share of the certified speed, above 0 and at most 1; None leaves it as it is set on the robot.
        security: Certificates, for a "tls/" endpoint.

    Raises:
        RefusedError: The robot does not play it; nothing moved.
        StoppedError: Somebody, or the robot itself, stopped the motion.
        RobotGoneError: Nobody answers, or the robot process died or froze.
    """
    told = 0

    def on_progress(progress: MotionProgress) -> None:
        nonlocal told
        share = progress.played * SHARES_TOLD // progress.samples
        if share > told:
            told = share
            say(
                f"{100 * share // SHARES_TOLD} %: {progress.played * SAMPLE_TIME:.1f} of {trajectory.duration:.1f} s "
                f"of the motion, speed {progress.state.speed:.2g}"
            )

    with CellClient.connect(endpoint, security=security) as client:
        wanted = client.state().speed_wanted if speed is None else speed
        say(f"robot: playing {trajectory.duration:.1f} s of motion at speed {wanted:g}")
        report = client.execute(trajectory, certificate, on_progress, speed)
    if not report.completed:
        raise StoppedError(
            f"the robot stopped by itself ({report.reason}): {report.detail}; look at the cell, then acknowledge with "
            "`replan robot acknowledge`"
        )
    moving = report.speed[report.speed > 0.0]
    return PlayReport(
        serial=report.final_state.motion_serial or "",
        samples=report.samples,
        seconds=float(report.times[-1]),
        slowest=float(moving.min()),
        fastest=float(moving.max()),
        max_tracking_error=report.max_tracking_error,
    )
