"""The simulated control box under validated, broken and unretimed motions, through the unmodified libfranka.

    validated   motions of the benchmark's cells, planned, retimed and passed by the verdict; none may be aborted
    broken      the same up to a stop, or at one row, with one limit broken each; each has to be aborted by its own name
    unretimed   the same planned paths at the planner's own timing (quintic laws between stops, as rollouts play them)

All are played in lockstep from where the box stands, in a world that holds the arm alone: what is under test are the
limits of the interface. Gripper events are rests of the arm.

    python -m benchmarks.robot_side.research_interface --runs 100
"""

import argparse
import json
import random
import re
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.motion.broken_limits import BREAKS, Motion
from benchmarks.motion.motion_scenes import MOTIONS, draw_scene
from benchmarks.robot_side.libfranka_motions import desired, play, robot_at, swing
from control.errors import StackError
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.kinematics import ArmKinematics
from control.robot.limits import REST_Q, RobotLimits, panda_limits
from control.simulation.rollouts import commands_for
from control.trajectory.samples import SAMPLE_TIME
from hw_interface.fci_simulator.process import ControlBoxProcess, free_address, start_control_box
from hw_interface.fci_simulator.server import Pace
from hw_interface.panda.scheduling import in_own_scheduling
from replan_base.processes import python_module
from sim_check.cells.loading import load_cell
from sim_check.twin.payloads import held_payloads
from sim_check.verdict.verdict import judge_trajectory

NAME = re.compile(r'\["([^\]]*)"\]')
COMPLETED = "completed"


@dataclass(frozen=True)
class Outcome:
    """What became of one motion.

    Attributes:
        name: Of the motion.
        kind: "validated", "unretimed" or the limit that was broken.
        expected: Error that it has to be aborted by; `COMPLETED` for none, empty where it is not told beforehand.
        got: Error that it was aborted by, or `COMPLETED`.
        seconds: Of robot time that the motion has.
    """

    name: str
    kind: str
    expected: str
    got: str
    seconds: float


def find_motions(count: int, say: Callable[[str], None]) -> list[Motion]:
    """The first `count` motions, seed by seed and task by task, that plan and pass."""
    found: list[Motion] = []
    robot, arm, limits = RobotModel.panda(), ArmKinematics.from_urdf(), panda_limits()
    for number in range(10 * count):
        name, seed = list(MOTIONS)[number % len(MOTIONS)], number // len(MOTIONS)
        motion = _find(name, seed, robot, arm, limits)
        say(f"{len(found)} of {count}: {name} {seed}: {motion if isinstance(motion, str) else 'passed'}")
        if isinstance(motion, Motion):
            found.append(motion)
        if len(found) == count:
            break
    return found


def _find(name: str, seed: int, robot: RobotModel, arm: ArmKinematics, limits: RobotLimits) -> Motion | str:
    rng = np.random.default_rng(seed)
    try:
        scene = draw_scene(MOTIONS[name], seed)
        safety = load_cell(MOTIONS[name].cell).safety_limits()
        plan = plan_motion(scene.believed, scene.spec, safety, rng, kinematics=arm, nthread=1)
        if not isinstance(plan, MotionPlan):
            return plan.message
        trajectory = retime(plan.path, robot, limits, safety, payloads=held_payloads(scene.believed))
        verdict = judge_trajectory(
            trajectory, scene.true, scene.spec, safety, limits, rng, perturbed=0, nthread=1, robot=robot
        )
    except StackError as error:
        return str(error)
    if not verdict.passed:
        return "; ".join(c.name for c in verdict.failed_checks)
    raw = commands_for(plan.path.segments, scene.believed, limits, SAMPLE_TIME).arm
    return Motion(f"{name} {seed}", trajectory.q, trajectory.segments[0].stop - 1, raw)


class Player:
    """Plays motions through libfranka on one simulated box, and returns to its ready pose in between."""

    def __init__(self, box: ControlBoxProcess) -> None:
        self._box, self._robot = box, robot_at(box.address)
        # Blows are meant to be felt by the joints: no force threshold before those of the torques.
        self._robot.set_collision_behavior(*[[40.0] * 7] * 2, *[[500.0] * 6] * 2)
        self.robot_seconds = 0.0

    def outcome(self, act: Callable[[Any], None]) -> str:
        """Begin at REST_Q, let `act` drive the robot; returns `COMPLETED` or the error that it was aborted by."""
        self._robot.automatic_error_recovery()
        here = desired(self._robot)
        way = np.array(REST_Q) - here
        if np.abs(way).max() > 0.0:
            play(self._robot, swing(here, way, 0.5 + 2.0 * float(np.abs(way).max())))
        try:
            act(self._robot)
        except RuntimeError as error:
            named = NAME.search(str(error))
            return named.group(1).replace('"', "") if named else str(error).splitlines()[0]
        return COMPLETED

    def samples(self, samples: np.ndarray, fault: tuple[str, int] | None = None) -> str:
        """Play joint positions in [rad], shape (n, 7), with a fault at a row."""
        self.robot_seconds += len(samples) * SAMPLE_TIME

        def at(row: int) -> None:
            if fault is not None and row == fault[1]:
                self._box.faults.send(fault[0])

        return self.outcome(lambda robot: play(robot, samples, at))

    def torques(self, torques: np.ndarray) -> str:
        """Play joint torques in [Nm], shape (n, 7)."""
        from panda_py import libfranka

        row = 0

        def torque(_state: Any, _duration: Any) -> Any:
            nonlocal row
            target = libfranka.Torques(torques[min(row, len(torques) - 1)].tolist())
            row += 1
            target.motion_finished = row >= len(torques)
            return target

        return self.outcome(
            lambda robot: in_own_scheduling(lambda answer: robot.control(answer, False, 1000.0), torque)
        )


def measure(motions: list[Motion], say: Callable[[str], None]) -> list[Outcome]:
    """Play everything; one box for all of it."""
    limits, outcomes = panda_limits(), []
    address = free_address(random.Random())
    with start_control_box(python_module("benchmarks.robot_side.research_interface", "--box", address)) as box:
        player = Player(box)
        for k, motion in enumerate(motions):
            done = [Outcome(motion.name, "validated", COMPLETED, player.samples(motion.samples), _s(motion.samples))]
            make = BREAKS[k % len(BREAKS)]
            broken = make(motion, limits, np.random.default_rng(k))
            if broken.samples is not None:
                got, played = player.samples(broken.samples, broken.fault), broken.samples
            else:
                assert broken.torques is not None
                got, played = player.torques(broken.torques), broken.torques
            done.append(Outcome(motion.name, make.__name__, broken.expected, got, _s(played)))
            done.append(Outcome(motion.name, "unretimed", "", player.samples(motion.raw), _s(motion.raw)))
            outcomes += done
            say(f"{k + 1} of {len(motions)}: {motion.name}: " + ", ".join(f"{o.kind}: {o.got}" for o in done))
    return outcomes


def _s(samples: np.ndarray) -> float:
    return len(samples) * SAMPLE_TIME


def report(outcomes: list[Outcome], wall: float) -> dict[str, Any]:
    """Counts by kind."""
    valid = [o for o in outcomes if o.kind == "validated"]
    raw = [o for o in outcomes if o.kind == "unretimed"]
    broken = [o for o in outcomes if o.kind not in ("validated", "unretimed")]
    wrong = [o for o in [*valid, *broken] if o.got != o.expected]
    return {
        "validated": {"motions": len(valid), "aborted": sum(o.got != COMPLETED for o in valid)},
        "broken": {
            "motions": len(broken),
            "aborted": sum(o.got != COMPLETED for o in broken),
            "by_the_right_name": sum(o.got == o.expected for o in broken),
            "by_kind": {
                kind: f"{sum(o.got == o.expected for o in broken if o.kind == kind)} of {count}"
                for kind, count in Counter(o.kind for o in broken).items()
            },
        },
        "unretimed": {
            "motions": len(raw),
            "aborted": sum(o.got != COMPLETED for o in raw),
            "by": dict(Counter(o.got for o in raw if o.got != COMPLETED).most_common()),
        },
        "robot_seconds_validated": sum(o.seconds for o in valid),
        "wall_seconds": wall,
        "unexpected": [asdict(o) for o in wrong],
    }


@dataclass
class ArmAlone:
    """A world that holds the arm and nothing else."""

    model: Any
    data: Any


def serve_box(address: str, control_port: int, parent: int, pace: Pace) -> None:
    """A simulated box in a world that holds the arm alone."""
    import mujoco

    from control.twin_model import ARM_ACTUATORS, ARM_JOINTS
    from hw_interface.cell.pacing import Leash
    from hw_interface.fci_simulator.server import ResearchInterface
    from sim_check.models.panda_mjcf import panda_spec

    model = panda_spec(meshes=False).compile()
    data = mujoco.MjData(model)
    for joint, servo, angle in zip(ARM_JOINTS, ARM_ACTUATORS, REST_Q, strict=True):
        data.joint(joint).qpos = angle
        data.actuator(servo).ctrl = angle
    world = ArmAlone(model, data)
    server = ResearchInterface(
        world,
        panda_limits(),
        address=address,
        pace=pace,
        control_port=control_port,
        say=lambda line: print(line, file=sys.stderr, flush=True),
        leash=Leash(parent),
    )
    server.serve()


def table(found: dict[str, Any]) -> str:
    """For people."""
    valid, broken, raw = found["validated"], found["broken"], found["unretimed"]
    lines = [
        f"validated   {valid['aborted']} of {valid['motions']} aborted (aim 0)",
        f"broken      {broken['by_the_right_name']} of {broken['motions']} aborted by the right name",
        *(f"              {kind:22} {count}" for kind, count in broken["by_kind"].items()),
        f"unretimed   {raw['aborted']} of {raw['motions']} aborted",
        *(f"              {count:4} {name}" for name, count in raw["by"].items()),
        f"{found['robot_seconds_validated']:.0f} s of validated motion; {found['wall_seconds']:.0f} s for everything",
        *(f"unexpected: {o['name']}, {o['kind']}: {o['got']}" for o in found["unexpected"]),
    ]
    return "\n".join(lines)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100, help="validated motions, and broken, and unretimed ones")
    parser.add_argument("--motions", type=Path, help="file (NPZ) to keep the motions in, or to read")
    parser.add_argument("--json", action="store_true")
    for hidden in ("--box", "--box-pace", "--control-port", "--parent-pid"):
        parser.add_argument(hidden, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.box:
        serve_box(given.box, int(given.control_port), int(given.parent_pid), given.box_pace or "lockstep")
        return 0

    def say(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    begun = time.monotonic()
    motions = read_motions(given.motions) if given.motions and given.motions.exists() else find_motions(given.runs, say)
    if given.motions and not given.motions.exists():
        write_motions(given.motions, motions)
    found = report(measure(motions[: given.runs], say), time.monotonic() - begun)
    print(json.dumps(found, indent=2) if given.json else table(found))
    return 0 if not found["unexpected"] else 1


def write_motions(path: Path, motions: list[Motion]) -> None:
    """Keep motions in an NPZ file."""
    arrays: dict[str, Any] = {"names": [m.name for m in motions], "stops": [m.first_stop for m in motions]}
    for k, m in enumerate(motions):
        arrays[f"samples{k}"], arrays[f"raw{k}"] = m.samples, m.raw
    np.savez_compressed(path, **arrays)


def read_motions(path: Path) -> list[Motion]:
    """Motions that `write_motions` kept."""
    with np.load(path) as a:
        stops = a["stops"]
        return [Motion(str(n), a[f"samples{k}"], int(stops[k]), a[f"raw{k}"]) for k, n in enumerate(a["names"])]


if __name__ == "__main__":
    sys.exit(main())
