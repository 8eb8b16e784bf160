"""Simulating many candidate motions in the twin, from start to end.

Every motion is played by the arm's position servos: quintic timings between stops, velocity feedforward, the
gripper at its finite speed. `mujoco.batch` steps them; its results do not depend on the number of threads.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from control.robot.limits import RobotLimits
from control.safety.residuals import HeldSpan
from control.simulation.batches import Observer, SimulatedBatch, simulate
from control.trajectory.samples import FINGERS, GripperCommand, PathSegment, TrajectorySegment
from control.twin_model import ARM_ACTUATORS, GRIPPER_ACTUATOR, TwinModel

GRIP_SETTLE = 0.15  # [s] after the fingers have arrived, for the grasp to come to rest
END_SETTLE = 0.2  # [s] at the end of a rollout
SEARCH_SPEED = 0.6  # share of the joint speed limits in search; retiming is slower, so grasps that hold here hold there
LEAST_TIME = 0.35  # [s] of any segment
CHUNK = 4  # motions that are simulated together; independent of the number of threads, as step counts depend on it


@dataclass(frozen=True)
class Commands:
    """What the servos are told, one row per simulated step.

    Attributes:
        arm: Joint positions in [rad], shape (n, 7).
        arm_speed: Joint speeds in [rad/s], shape (n, 7).
        finger: Half of the commanded distance between the pads in [m], shape (n,).
        held: Objects in the hand and when, by step.
        free: Stretches (start, stop) in which a held object may touch nothing.
        stops: For each segment of a path the steps after which the arm has come to rest, and after which the gripper
            has done what it was told there; empty for trajectories.
        handled: What the fingers are at and when, by step: an object, or a joint by its handle.
    """

    arm: NDArray[np.float64]
    arm_speed: NDArray[np.float64]
    finger: NDArray[np.float64]
    held: tuple[HeldSpan, ...]
    free: tuple[tuple[int, int], ...] = ()
    stops: tuple[tuple[int, int], ...] = ()
    handled: tuple[HeldSpan, ...] = ()


def commands_for(
    segments: Sequence[PathSegment], twin: TwinModel, limits: RobotLimits, step: float | None = None
) -> Commands:
    """Play path segments with quintic timings, each from rest to rest.

        s(u) = u^3 (10 - 15 u + 6 u^2),  largest speed 15/8 of the mean

    Args:
        segments: A candidate's path.
        twin: For the start of arm and gripper and for its time step.
        limits: Joint speeds; segments use `SEARCH_SPEED` times their own share of them.
        step: Time between rows in [s]; the model's own by default.
    """
    dt = float(twin.model.opt.timestep) if step is None else step
    arm, speed, finger = [], [], []
    closed_for = twin.held
    target = squeeze(twin, None) if twin.held else twin.gripper_width / 2
    at = twin.gripper_width / 2  # where the fingers are, while the target may press further
    held: list[HeldSpan] = []
    free: list[tuple[int, int]] = []
    stops: list[tuple[int, int]] = []
    handled: list[HeldSpan] = []
    count = 0
    for segment in segments:
        q, qd = _quintic(segment.q, limits, segment.speed_scale, dt)
        arm.append(q)
        speed.append(qd)
        finger.append(np.full(len(q), target))
        if segment.held is not None:
            held.append(HeldSpan(segment.held, count, count + len(q)))
            if not segment.touching:
                free.append((count, count + len(q)))
        count += len(q)
        arrived = count
        if segment.gripper is not None:
            ramp = gripper_ramp(twin, at, segment.gripper, dt)
            rest = np.concatenate([ramp, np.full(round(GRIP_SETTLE / dt), ramp[-1])])
            arm.append(np.repeat(segment.q[-1:], len(rest), axis=0))
            speed.append(np.zeros((len(rest), 7)))
            finger.append(rest)
            target, at = float(ramp[-1]), segment.gripper.width / 2
            count += len(rest)
            closed_for = None
        stops.append((arrived, count))
        name = handled_in(segment)
        if name is not None:
            handled.append(HeldSpan(name, arrived - len(q), count))
    rest = round(END_SETTLE / dt)
    arm.append(np.repeat(segments[-1].q[-1:], rest, axis=0))
    speed.append(np.zeros((rest, 7)))
    finger.append(np.full(rest, target))
    last = segments[-1].held or closed_for
    if last is not None and segments[-1].gripper is None:
        held.append(HeldSpan(last, count, count + rest))
    return Commands(
        np.concatenate(arm),
        np.concatenate(speed),
        np.concatenate(finger),
        merge_spans(held),
        tuple(free),
        tuple(stops),
        merge_spans(handled),
    )


def handled_in(segment: PathSegment | TrajectorySegment) -> str | None:
    """What the fingers are at during a segment: what they hold, else the first thing that they may touch."""
    return segment.held or next((a for a, b in segment.touching if b == FINGERS), None)


def squeeze(twin: TwinModel, command: GripperCommand | None) -> float:
    """Finger target in [m] that presses with a grasp's force; fully closed for what is in the hand at the start.

    The servo drives one finger and the coupling shares its force between both: x = width / 2 - 2 F / k.
    """
    if command is None:
        return 0.0
    stiffness = float(twin.model.actuator(GRIPPER_ACTUATOR).gainprm[0])
    return max(0.0, command.width / 2 - 2 * command.force / stiffness)


def gripper_ramp(twin: TwinModel, at: float, command: GripperCommand, dt: float) -> np.ndarray:
    """Finger targets in [m] from where the fingers are to what a command asks for, at their speed, shape (n >= 1,)."""
    goal = squeeze(twin, command) if command.kind == "grasp" else command.width / 2
    count = max(1, int(np.ceil(abs(goal - at) / twin.gripper.planned_speed / dt)))
    return at + (goal - at) * np.arange(1, count + 1) / count


def merge_spans(spans: Sequence[HeldSpan]) -> tuple[HeldSpan, ...]:
    """Join spans of the same object that follow one another, short rests at gripper commands included."""
    out: list[HeldSpan] = []
    for span in spans:
        if out and out[-1].name == span.name and span.start == out[-1].stop:
            out[-1] = HeldSpan(span.name, out[-1].start, span.stop)
        else:
            out.append(span)
    return tuple(out)


def controls_for(model: mujoco.MjModel, commands: Commands) -> np.ndarray:
    """Servo targets of all actuators, shape (n, nu): q + (kv / kp) qd, so that damping does not hold the arm back."""
    out = np.zeros((len(commands.arm), model.nu))
    for joint, name in enumerate(ARM_ACTUATORS):
        servo = model.actuator(name)
        lead = float(servo.biasprm[2] / servo.biasprm[1]) if servo.biasprm[1] else 0.0
        out[:, servo.id] = commands.arm[:, joint] + lead * commands.arm_speed[:, joint]
    out[:, model.actuator(GRIPPER_ACTUATOR).id] = commands.finger
    return out


@dataclass(frozen=True)
class Rollout:
    """States of one simulated motion.

    Attributes:
        model: The model that it was simulated with.
        time: Times in [s], shape (n,); row 0 is the start.
        qpos: Configurations, shape (n, nq).
        qvel: Velocities, shape (n, nv).
        ctrl: Servo targets that led to the next row, shape (n, nu).
        commands: What was played.
    """

    model: mujoco.MjModel
    time: NDArray[np.floating]
    qpos: NDArray[np.float64]
    qvel: NDArray[np.float64]
    ctrl: NDArray[np.float64]
    commands: Commands

    @property
    def end(self) -> np.ndarray:
        """Configuration at the end, shape (nq,)."""
        return self.qpos[-1]

    @property
    def exploded(self) -> bool:
        """Whether the simulation broke down."""
        return not bool(np.isfinite(self.qpos[-1]).all() and np.abs(self.qvel).max() < 100.0)


def roll_out(
    twins: Sequence[TwinModel],
    motions: Sequence[Commands],
    nthread: int,
    step: float | None = None,
    observe: Observer | None = None,
) -> tuple[list[Rollout], int]:
    """Simulate motion i in twin i, all of them to their end.

    Args:
        twins: One twin per motion; the models must have the same layout.
        motions: What to play, with rows at the step that is simulated.
        nthread: Threads; the result does not depend on it.
        step: Time step in [s]; the models' own by default.
        observe: Told of each batch that is simulated.

    Returns:
        Rollouts in the same order, and the number of simulated steps.
    """
    first = twins[0].model
    dt = float(first.opt.timestep) if step is None else step
    models: dict[int, mujoco.MjModel] = {}
    for twin in twins:
        if id(twin.model) not in models:
            models[id(twin.model)] = twin.model if step is None else _with_step(twin.model, step)
    own = [models[id(t.model)] for t in twins]
    out: list[Rollout | None] = [None] * len(twins)
    steps = 0
    # Motions of like length together, so that little is simulated beyond a motion's end.
    order = sorted(range(len(twins)), key=lambda i: len(motions[i].arm))
    for chunk in _chunks(order, CHUNK):
        longest = max(len(motions[i].arm) for i in chunk)
        inputs = np.zeros((len(chunk), longest, first.nu))
        starts = np.empty((len(chunk), first.nq))
        for row, i in enumerate(chunk):
            starts[row] = twins[i].qpos
            target = controls_for(own[i], motions[i])
            inputs[row, : len(target)] = target
            inputs[row, len(target) :] = target[-1]
        still = np.zeros((len(chunk), first.nv))
        batch = SimulatedBatch(tuple(own[i] for i in chunk), starts, still, still, inputs, nthread)
        record = simulate(batch, ("qpos", "qvel"), observe)
        steps += len(chunk) * longest
        for row, i in enumerate(chunk):
            n = len(motions[i].arm)
            out[i] = Rollout(
                own[i],
                np.arange(n + 1) * dt,
                np.vstack([starts[row][None], record["qpos"][row, :n]]),
                np.vstack([np.zeros((1, first.nv)), record["qvel"][row, :n]]),
                np.vstack([inputs[row, :n], inputs[row, n - 1 : n]]),
                motions[i],
            )
    return [r for r in out if r is not None], steps


def _quintic(path: np.ndarray, limits: RobotLimits, scale: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and speeds along a polyline at `dt`, without its first point."""
    share = np.abs(np.diff(path, axis=0)) / limits.qd
    arc = np.concatenate([[0.0], np.cumsum(share.max(axis=1) + 1e-9)])  # [s] at full speed
    time = max(LEAST_TIME, 15 / 8 * arc[-1] / (SEARCH_SPEED * scale))
    count = max(2, round(time / dt))
    u = np.arange(1, count + 1) / count
    s = u**3 * (10 - 15 * u + 6 * u**2) * arc[-1]
    q = np.stack([np.interp(s, arc, path[:, j]) for j in range(path.shape[1])], axis=1)
    qd = np.gradient(np.vstack([path[:1], q]), dt, axis=0)[1:]
    qd[-1] = 0.0
    return q, qd


def _with_step(model: mujoco.MjModel, step: float) -> mujoco.MjModel:
    out = copy.copy(model)
    out.opt.timestep = step
    return out


def _chunks(items: list[int], size: int) -> list[list[int]]:
    return [items[i : i + size] for i in range(0, len(items), size)]
