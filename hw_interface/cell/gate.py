"""The gate: what a trajectory must show before a robot plays it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from control.errors import RefusedError, TrajectoryError
from control.robot.gripper import PANDA_HAND, GripperModel
from control.robot.limits import RobotLimits
from control.safety.certificate import Certificate
from control.safety.certification import verify_certificate
from control.safety.limits import SafetyLimits
from control.safety.trajectory_checks import check_trajectory
from control.trajectory.playback import check_rate
from control.trajectory.samples import Trajectory
from hw_interface.cell.backend import Measured


@dataclass(frozen=True)
class Gate:
    """Checks a trajectory against its certificate and, sample by sample, against the robot's limits.

    The driver trusts nobody with the samples: it repeats every check that needs no twin.

    Attributes:
        profile: Robot profile, for instance "panda/5".
        limits_hash: Hash of the limits that a certificate must have been issued under.
        robot_limits: Published limits of the robot.
        safety: The safety table of the cell.
        max_scene_age: Oldest frame in [s] that a motion may have been judged on.
        torque: (q, qd, qdd), each (n, 7), -> joint torques in [Nm], (n, 7); None leaves torques to the certificate.
        tcp: q (n, 7) -> poses of the tool centre point, (n, 4, 4); None leaves hand speeds to the certificate.
        gripper: What the robot carries; it must be able to do what a motion asks of it.
    """

    profile: str
    limits_hash: str
    robot_limits: RobotLimits
    safety: SafetyLimits
    max_scene_age: float = 300.0
    torque: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray] | None = None
    tcp: Callable[[np.ndarray], np.ndarray] | None = None
    gripper: GripperModel = PANDA_HAND

    @property
    def firmware(self) -> str:
        """Firmware family of the robot, to which its limits belong."""
        return self.robot_limits.firmware

    @property
    def playing_limits(self) -> RobotLimits:
        """The cell's shares of the robot's limits, which every motion keeps unless it is being stopped."""
        return self.robot_limits.scaled(self.safety.velocity_scale, self.safety.acceleration_scale)

    def check(
        self,
        trajectory: Trajectory,
        certificate: Certificate | None,
        q_d: np.ndarray,
        measured: Measured,
        now: float,
        used_serials: set[str],
    ) -> Certificate:
        """The certificate, if this trajectory may be played now.

        Args:
            q_d: Where the robot is commanded to be in [rad], shape (7,).
            measured: What it measures.
            now: Time on the robot's clock in [s].
            used_serials: Serials of certificates that were played.

        Raises:
            RefusedError: Any code of `control.safety.certification.verify_certificate`, breaks_limit, or
                start_mismatch.
        """
        verify_certificate(
            certificate,
            trajectory,
            self.profile,
            self.firmware,
            self.limits_hash,
            now,
            used_serials,
            q_d,
            self.max_scene_age,
        )
        assert certificate is not None
        self.check_limits(trajectory)
        self._check_gripper(trajectory, measured)
        return certificate

    def check_limits(self, trajectory: Trajectory) -> None:
        """Hold every sample against the robot's limits and the cell's shares of them.

        Args:
            trajectory: From rest to rest: a certified one, or what is commanded of it at another speed.

        Raises:
            RefusedError: breaks_limit.
        """
        checks = check_trajectory(trajectory, self.robot_limits, self.safety, self.torque, self.tcp)
        broken = [c for c in checks if not c.ok]
        if broken:
            c = broken[0]
            where = f" at {c.at:.3f} s" if c.at is not None else ""
            who = f" ({', '.join(c.bodies)})" if c.bodies else ""
            others = f"; also broken: {', '.join(o.name for o in broken[1:])}" if broken[1:] else ""
            raise RefusedError(
                "breaks_limit",
                f"check {c.name}: {c.worst:.6g} {c.unit}{where}{who}, limit {c.limit:.6g} {c.unit}{others}",
            )

    def _check_gripper(self, trajectory: Trajectory, measured: Measured) -> None:
        for event in trajectory.gripper:
            command, able = event.command, self.gripper
            least = able.least_force if command.kind == "grasp" else 0.0
            if not (0.0 <= command.width <= able.opening and least <= command.force <= able.most_force):
                raise RefusedError(
                    "breaks_limit",
                    f"gripper command at {event.time:.2f} s asks for {command.width:g} m and {command.force:g} N; "
                    f"'{able.name}' is able to do 0 to {able.opening:g} m and {least:g} to {able.most_force:g} N",
                )
        if trajectory.segments and trajectory.segments[0].held is not None and not measured.grasped:
            raise RefusedError(
                "start_mismatch",
                f"the motion begins with '{trajectory.segments[0].held}' in the hand, but the gripper holds nothing",
            )


def valid_speed(speed: float) -> float:
    """The speed, if motions may be played at it: above 0 and at most 1, the speed that they were judged at.

    Raises:
        RefusedError: bad_speed.
    """
    try:
        check_rate(speed)
    except TrajectoryError as error:
        raise RefusedError("bad_speed", str(error)) from error
    return speed
