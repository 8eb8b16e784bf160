"""What a driver watches while it plays: tracking error, contact, gripper deadlines, the grasp. Needs numpy only."""

from dataclasses import dataclass

import numpy as np

from control.trajectory.samples import SAMPLE_TIME, GripperEvent, Trajectory
from hw_interface.cell.backend import Measured
from hw_interface.messages.robot import Trouble

# The one trouble that is no reflex: the hand stood still, closed on nothing and holds nothing. Nothing was touched or
# lost, so the motion ends where the arm stands and the robot stays ready.
MISSED_GRASP = "missed_grasp"
REST_SPEED = 1e-6  # [rad/s]; samples slower than this stand still


@dataclass(frozen=True)
class MonitorLimits:
    """Where a driver stops by itself. Wider than the limits of a verdict: these catch what no twin foresaw.

    Attributes:
        tracking_error: Largest difference per joint between commanded and measured position in [rad].
        contact_force: Highest force on arm and hand, fingers not counted, in [N].
        contact_time: How long the force must last in [s]; shorter peaks are noise of a contact solver or sensor.
        grasp_time: How long a grasp must be gone in [s].
        gripper_width: Largest difference between asked and reached width at the end of a dwell in [m].
        gripper_patience: How much longer than its dwell a gripper may take in [s] while the arm rests and waits for it.
    """

    tracking_error: float = 0.05
    contact_force: float = 30.0
    contact_time: float = 0.005
    grasp_time: float = 0.05
    gripper_width: float = 0.004
    gripper_patience: float = 2.0


@dataclass(frozen=True)
class _Deadline:
    sample: int
    event: GripperEvent


def _sample_of(time: float) -> int:
    return round(time / SAMPLE_TIME)


def expects_grasp(trajectory: Trajectory) -> np.ndarray:
    """At which samples the gripper must hold something, bool, shape (n,).

    That is where a segment names a held object, except while a gripper command is under way and from a command to
    open on until the next grasp (a release belongs to the segment that still names the object).
    """
    expected = np.zeros(len(trajectory.q), bool)
    for segment in trajectory.segments:
        if segment.held is not None:
            expected[segment.start : segment.stop] = True
    starts = [_sample_of(e.time) for e in trajectory.gripper]
    for i, (event, start) in enumerate(zip(trajectory.gripper, starts, strict=True)):
        following = starts[i + 1] if i + 1 < len(starts) else len(expected)
        end = _sample_of(event.time + event.dwell) if event.command.kind == "grasp" else following
        expected[start:end] = False
    return expected


class MotionMonitor:
    """Watches one motion, sample by sample.

    Attributes:
        waiting: Whether the arm should stay where it rests: the gripper needs longer than its dwell.
    """

    def __init__(self, trajectory: Trajectory, limits: MonitorLimits) -> None:
        self.waiting = False
        self._waited = 0
        self._qd = trajectory.qd
        self._limits = limits
        self._expects_grasp = expects_grasp(trajectory)
        self._segments = trajectory.segments
        self._deadlines = [_Deadline(_sample_of(e.time + e.dwell), e) for e in trajectory.gripper]
        self._contact_samples = 0
        self._lost_samples = 0

    def check(self, sample: int, measured: Measured, tracking_error: float) -> Trouble | None:
        """Why to stop before commanding this sample, or None.

        Args:
            sample: Index of the sample that is commanded next; the number of samples after the last one.
            measured: What the robot measures now.
            tracking_error: Largest joint difference between the last command and the measurement in [rad].
        """
        limits, self.waiting = self._limits, False
        if tracking_error > limits.tracking_error:
            return Trouble(
                code="tracking_error",
                reason=f"a joint is {tracking_error:.3f} rad away from its command, more than "
                f"{limits.tracking_error:g} rad; something holds or pushes the arm: look, clear it, then acknowledge",
            )
        return self._contact(measured) or self._gripper(sample, measured) or self._grasp(sample, measured)

    def _contact(self, measured: Measured) -> Trouble | None:
        force = measured.contact_force
        self._contact_samples = (
            self._contact_samples + 1 if force is not None and force > self._limits.contact_force else 0
        )
        if force is None or self._contact_samples * SAMPLE_TIME <= self._limits.contact_time:
            return None
        return Trouble(
            code="contact",
            reason=f"arm or hand press against something with {force:.0f} N, more than "
            f"{self._limits.contact_force:g} N; clear it, then acknowledge",
        )

    def _gripper(self, sample: int, measured: Measured) -> Trouble | None:
        while self._deadlines and self._deadlines[0].sample <= sample:
            if measured.gripper_busy and self._may_wait(sample):
                self._waited += 1
                self.waiting = True
                return None
            event, self._waited = self._deadlines.pop(0).event, 0
            command, width = event.command, measured.gripper_width
            told = f"told to {command.kind} at {event.time:.2f} s"
            if measured.gripper_busy:
                return Trouble(
                    code="gripper_late",
                    reason=f"the gripper, {told}, is not done after its {event.dwell:g} s and "
                    f"{self._limits.gripper_patience:g} s more (width {width * 1e3:.0f} mm)",
                )
            if command.kind == "grasp" and not measured.grasped:
                return Trouble(
                    code=MISSED_GRASP,
                    reason=f"the gripper, {told}, holds nothing (width {width * 1e3:.0f} mm): the object is not where "
                    "it was expected",
                )
            if command.kind == "move" and abs(width - command.width) > self._limits.gripper_width:
                return Trouble(
                    code="gripper_late",
                    reason=f"the gripper, {told} to {command.width * 1e3:.0f} mm, stands at {width * 1e3:.0f} mm",
                )
        return None

    def _may_wait(self, sample: int) -> bool:
        """Whether the arm rests at this sample and has not waited there too long."""
        around = self._qd[max(0, sample - 1) : sample + 1]
        return bool(
            self._waited * SAMPLE_TIME < self._limits.gripper_patience and np.abs(around).max(initial=0.0) <= REST_SPEED
        )

    def _grasp(self, sample: int, measured: Measured) -> Trouble | None:
        expected = sample < len(self._expects_grasp) and bool(self._expects_grasp[sample])
        self._lost_samples = self._lost_samples + 1 if expected and not measured.grasped else 0
        if self._lost_samples * SAMPLE_TIME <= self._limits.grasp_time:
            return None
        segment = next((s for s in self._segments if s.start <= sample < s.stop), None)
        what = segment.held if segment and segment.held else "the object"
        return Trouble(code="lost_grasp", reason=f"{what} slipped out of the gripper at {sample * SAMPLE_TIME:.2f} s")
