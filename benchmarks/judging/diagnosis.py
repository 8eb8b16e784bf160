"""How often the right cause of a failure is named, over seeded simulated cells and errors of perception.

Each case is a subtask that fails, or does not, for a reason that is true by construction: a bar behind handles, a
kettle in a door's swing, a bolt that nobody sees, a crate that is taken, nothing at all. Every world is pushed first,
to make sure that it is as the case says. The stack under test gets estimates only: the truth, or the truth with errors
on every pose, of furniture as well. What is compared is the typed cause: its kind and its bodies.

    python -m benchmarks.judging.diagnosis --runs 20
    python -m benchmarks.judging.diagnosis --runs 20 --pose-noise-mm 10 --yaw-noise-deg 4 --json
"""

import argparse
import json
import sys
import time
from dataclasses import dataclass, field

import mujoco
import numpy as np

from benchmarks.scenes.estimates import noisy_scene
from control.errors import StackError
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.robot.kinematics import ArmKinematics
from control.robot.limits import REST_Q
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec, RewardTerm
from perception.estimates import SceneEstimate
from sim_check.cells.cell_config import CellConfig
from sim_check.cells.loading import load_cell
from sim_check.diagnosis.blocking_bodies import diagnose
from sim_check.twin.twin import build_twin
from sim_check.world.world import World, build_world

TRUE_PUSH = 6.0  # [Nm] beyond dry friction, with which joints are pushed in the truth; 20 N at a handle
LONGEST = 4.0  # [s] of such a push
MOVES = 0.95  # share of the way that counts as open
ASIDE = 0.02  # [m] that nothing else may be moved by
OPEN_WIDTH = 0.08  # [m]


@dataclass(frozen=True)
class Case:
    """A subtask with a known reason of its failure.

    Attributes:
        name: For the table.
        cell: Built-in cell.
        term: The primary term.
        kind: Kind of the right cause; None when nothing is wrong.
        bodies: Bodies of the right cause.
    """

    name: str
    cell: str
    term: RewardTerm
    kind: str | None
    bodies: tuple[str, ...] = ()


def _opening(joint: str, fraction: float) -> RewardTerm:
    return RewardTerm("set_joint_fraction", joint, None, fraction, primary=True)


CASES = (
    Case("bar", "cabinet-blocked", _opening("wooden_cabinet_left_door", 0.7), "blocked_by", ("red_bar",)),
    Case("kettle", "kitchen-explore", _opening("microwave_door", 0.7), "blocked_by", ("kettle",)),
    Case("lever lock", "cabinet-locked", _opening("wooden_cabinet_door", 0.7), "locked"),
    Case("plate lock", "composite-explore", _opening("stone_cabinet_door", 0.8), "locked"),
    Case("none", "cabinet-closed", _opening("wooden_cabinet_left_door", 0.7), None),
    Case(
        "occupied",
        "cubes-blocked",
        RewardTerm("minimize_l2_distance", "red_cube", "crate", primary=True),
        "blocked_by",
        ("yellow_cube",),
    ),
)


@dataclass(frozen=True)
class Errors:
    """Errors of perception.

    Attributes:
        position: Spread along each axis in [m], normal, cut at twice the spread.
        yaw_deg: Spread of yaws in [degrees].
    """

    position: float = 0.0
    yaw_deg: float = 0.0

    @property
    def label(self) -> str:
        """As in the output."""
        if self.position == 0.0 and self.yaw_deg == 0.0:
            return "poses"
        return f"{self.position * 1e3:g}mm_{self.yaw_deg:g}deg"


@dataclass
class Score:
    """What came of a case.

    Attributes:
        right: Whether the cause was right, per run.
        wall_s: Seconds that the diagnosis took, per run.
        wrong: What was said instead, with the seed.
    """

    right: list[bool] = field(default_factory=list)
    wall_s: list[float] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)

    def as_json(self) -> dict:
        """As one JSON object."""
        return {
            "runs": len(self.right),
            "right": sum(self.right),
            "median_wall_s": round(float(np.median(self.wall_s)), 2),
            "wrong": self.wrong,
        }


def check_truth(world: World, case: Case) -> None:
    """Make sure that the world is as the case says: pushed, a free joint moves and moves nothing else, any other not.

    Raises:
        StackError: It is not; the case and not the diagnosis is at fault.
    """
    if case.term.kind != "set_joint_fraction":
        return
    joint, fraction = case.term.subject, float(case.term.value or 0.0)
    model, data = world.model, mujoco.MjData(world.model)
    data.qpos[:], data.ctrl[:] = world.data.qpos, world.data.ctrl
    dof = int(model.joint(joint).dofadr[0])
    hinge = model.jnt_type[model.joint(joint).id] == mujoco.mjtJoint.mjJNT_HINGE
    push = float(model.dof_frictionloss[dof]) + TRUE_PUSH * (1.0 if hinge else 4.0)
    sign = float(np.sign(next(p for f in world.furniture.values() if (p := f.part(joint))).opened))
    for _ in range(round(LONGEST / model.opt.timestep)):
        # A push of limited speed, so that what stands in the way is leant on and not hit.
        data.qfrc_applied[dof] = sign * push * max(0.0, 1.0 - abs(float(data.qvel[dof])))
        mujoco.mj_step(model, data)
        if world.joint_fraction(joint, data) >= MOVES * fraction:
            break
    way = [np.linalg.norm(world.object_pose(n, data)[:3, 3] - world.object_pose(n)[:3, 3]) for n in world.objects]
    free = world.joint_fraction(joint, data) >= MOVES * fraction and max(way, default=0.0) < ASIDE
    if free != (case.kind is None):
        raise StackError(f"case '{case.name}': pushed in the truth, '{joint}' is {'' if free else 'not '}free to move")


def perceived(world: World, cell: CellConfig, errors: Errors, rng: np.random.Generator) -> SceneEstimate:
    """What the stack is told: poses of what is in sight, with errors; what lies in closed furniture is out of sight."""
    placements = cell.simulation.placements if cell.simulation else ()
    hidden = {p.object for p in placements if p.lies_in in cell.furniture}
    fraction = 0.01 if errors.position > 0.0 else 0.0
    return noisy_scene(world, rng, errors.position, errors.yaw_deg, fraction, without=hidden)


def explain(
    cell: CellConfig, scene: SceneEstimate, case: Case, seed: int, arm: ArmKinematics
) -> tuple[FailureCause | None, float]:
    """The cause that the stack finds from estimates alone, and the seconds that the diagnosis took.

    A subtask that nothing keeps from being done is searched a motion for: None when there is one. Any other was tried
    in vain: the search's own failure is explained where it has one, else that a motion did not help.
    """
    spec, safety = RewardSpec((case.term,)), cell.safety_limits()
    twin = build_twin(cell, scene, np.array(REST_Q), OPEN_WIDTH)
    failure = None
    if case.kind is None or case.term.kind != "set_joint_fraction":
        found = plan_motion(twin, spec, safety, np.random.default_rng(seed), kinematics=arm)
        if isinstance(found, MotionPlan) and case.kind is None:
            return None, found.stats.seconds
        failure = found if isinstance(found, FailureCause) else None
    began = time.perf_counter()
    cause = diagnose(twin, spec, failure, safety, np.random.default_rng(seed + 1), arm)
    return cause, time.perf_counter() - began


def run_case(case: Case, errors: Errors, seed: int, arm: ArmKinematics, score: Score) -> str:
    """One world, one diagnosis; returns what was said."""
    cell = load_cell(case.cell)
    world = build_world(cell, seed, meshes=False)
    check_truth(world, case)
    scene = perceived(world, cell, errors, np.random.default_rng([seed, 7]))
    try:
        cause, seconds = explain(cell, scene, case, seed, arm)
    except StackError as error:
        cause, seconds = FailureCause("not_seen", case.term.subject, str(error)), float("nan")
    said = "nothing is in the way" if cause is None else f"{cause.kind} {list(cause.bodies) or ''}: {cause.message}"
    answer = (None, ()) if cause is None else (cause.kind, cause.bodies)
    right = answer == (case.kind, case.bodies)
    score.right.append(right)
    if np.isfinite(seconds):
        score.wall_s.append(seconds)
    if not right:
        score.wrong.append(f"seed {seed}: {said}")
    return said


def main() -> int:
    """Parse, run, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=20, help="seeds of each case")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--cases", nargs="+", default=[c.name for c in CASES], choices=[c.name for c in CASES])
    parser.add_argument("--pose-noise-mm", type=float, default=5.0, help="spread per axis of the second table")
    parser.add_argument("--yaw-noise-deg", type=float, default=2.0, help="spread of yaws of the second table")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    options = parser.parse_args()
    arm = ArmKinematics.from_urdf()
    noisy = Errors(options.pose_noise_mm * 1e-3, options.yaw_noise_deg)
    result: dict[str, dict[str, dict]] = {}
    for errors in dict.fromkeys((Errors(), noisy)):
        rows = result.setdefault(errors.label, {})
        for case in (c for c in CASES if c.name in options.cases):
            score = Score()
            for seed in range(options.first_seed, options.first_seed + options.runs):
                said = run_case(case, errors, seed, arm, score)
                mark = "ok" if score.right[-1] else "WRONG"
                print(f"{errors.label} {case.name} seed {seed}: {mark}, {said}", file=sys.stderr, flush=True)
            rows[case.name] = score.as_json()
    if options.json:
        print(json.dumps({"diagnosis": result}))
        return 0
    for label, rows in result.items():
        print(f"{'true poses' if label == 'poses' else label.replace('_', ', ') + ' on every pose'}")
        print(f"  {'case':12}{'right':>9}{'median s':>10}")
        for name, row in rows.items():
            print(f"  {name:12}{row['right']:>5}/{row['runs']:<3}{row['median_wall_s']:>10.2f}")
            for said in row["wrong"]:
                print(f"      {said}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
