"""Faults injected into the real driver on the simulated control box, seeded; what moved, what rested, what was said.

Box (lockstep), supervisor, player and gripper are processes of their own; the operator's client goes through a link
that can misbehave. For each injection the operator sends a certified motion, the fault comes at a random moment of it,
and everything is judged on the box's history: nothing may move without a valid certificate or off its path, nobody may
report a motion as done that was not, every audit log must be readable, and nothing may move again until a person has
acknowledged.

    python -m benchmarks.robot_side.faults --injections 308
"""

import argparse
import contextlib
import json
import multiprocessing
import os
import queue
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.robot_side.fault_judgement import judge_movement
from benchmarks.robot_side.fault_kinds import KINDS, Kind, Scene
from benchmarks.robot_side.faulty_link import FaultyLink
from benchmarks.robot_side.panda_side import PandaSide, acknowledge, certified, gate, panda_side, wait_for_progress
from control.errors import RefusedError, StackError
from control.motion_files.trajectory_file import write_trajectory
from control.robot.limits import REST_Q
from control.safety.certificate_file import write_certificate
from control.trajectory.samples import GripperCommand, GripperEvent, Trajectory, TrajectorySegment
from hw_interface.cell.audit_log import DamagedLine, read_audit_log
from hw_interface.cell.client import CellClient
from hw_interface.cell.gate import Gate
from replan_base.processes import python_module

STILL = 0.4  # [s] of wall time after the rest in which nothing may move
REST = 10.0  # [s] of wall time that a motion may go on after the operator knows; its box may wait for a clearance
LOOK = 2.0  # [s] of wall time between two looks whether those who inject are still there
ENDS = 30.0  # [s] of wall time that an injection may take until the operator knows


@dataclass(frozen=True)
class Injection:
    """What became of one fault.

    Attributes:
        kind, seed: Which.
        outcome: completed, rests, refused (and the motion itself completed), or moving: it was not at rest at the end.
        said: What the operator was told: completed, or the error's name and code.
        right: Whether that is what has to come of it.
        uncertified: Rows of motion that no certificate allows.
        departure: From the certified path by what a client commanded, in [rad].
        to_rest: Robot time from the fault to rest in [s].
        false_done: Reported as done, and it was not.
        log_readable: Whether the audit log had no damaged line but perhaps the last.
        refused: Code of the refusal of what was asked in addition, or None.
        note: What went wrong with the injection itself.
    """

    kind: str
    seed: int
    outcome: str
    said: str
    right: bool
    uncertified: int
    departure: float
    to_rest: float | None
    false_done: bool
    log_readable: bool
    refused: object = None
    note: str = ""


def random_motion(client: CellClient, of: Gate, rng: np.random.Generator, grip: bool) -> Trajectory:
    """From where the arm is held to somewhere near and back, as slow as the gate wants it.

    With `grip` there is a gripper command in between.
    """
    q0, home = np.array(client.state().q_d), np.array(REST_Q)
    q1 = home + rng.uniform(-0.35, 0.35, 7) * np.array([1, 0.5, 1, 0.5, 1, 0.5, 1])
    seconds, width = float(rng.uniform(1.2, 2.0)), float(rng.uniform(0.02, 0.07))
    while True:
        motion = _there_and_back(q0, q1, seconds, width if grip else None)
        try:
            of.check_limits(motion)
        except RefusedError:
            seconds *= 1.2
        else:
            return motion


def _there_and_back(q0: np.ndarray, q1: np.ndarray, seconds: float, width: float | None) -> Trajectory:
    n = round(seconds * 1000)
    t = np.linspace(0.0, 1.0, n + 1)[:, None]
    # Septic: jerk is continuous, so that a stop may begin anywhere.
    s = 35 * t**4 - 84 * t**5 + 70 * t**6 - 20 * t**7
    dwell = 0 if width is None else 800
    there, back = q0 + s * (q1 - q0), q1 + s[1:] * (q0 - q1)
    q = np.concatenate([there, np.repeat(q1[None], dwell, axis=0), back])
    padded = np.concatenate([q[:1], q, q[-1:]])
    qd = (padded[2:] - padded[:-2]) / 2e-3
    qdd = (padded[2:] - 2 * q + padded[:-2]) / 1e-6
    for k in (0, -1):
        qd[k], qdd[k] = 0.0, 0.0
    events = () if width is None else (GripperEvent(n / 1000, dwell / 1000, GripperCommand("move", width)),)
    segments = (TrajectorySegment("there", 0, n + 1), TrajectorySegment("back", n + 1, len(q)))
    return Trajectory(q, qd, qdd, events, segments)


class Operator:
    """The operator: a client on a thread, or `replan robot play` as a process of its own."""

    def __init__(self, scene: Scene, own_process: bool, folder: Path) -> None:
        self.said = ""
        self.pid: int | None = None
        self._process: subprocess.Popen[str] | None = None
        self._thread: threading.Thread | None = None
        if own_process:
            write_trajectory(folder / "motion.npz", scene.trajectory)
            write_certificate(folder / "certificate.json", scene.certificate)
            command = python_module("replan.main", "robot", "play", str(folder / "motion.npz"))
            command += [str(folder / "certificate.json"), "--robot", scene.link.endpoint, "--json"]
            self._process = subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True
            )
            self.pid = self._process.pid
        else:
            self._thread = threading.Thread(target=self._run, args=(scene,), daemon=True)
            self._thread.start()

    def _run(self, scene: Scene) -> None:
        try:
            with CellClient.connect(scene.link.endpoint) as client:
                report = client.execute(scene.trajectory, scene.certificate)
                self.said = "completed" if report.completed else report.reason
        except RefusedError as error:
            self.said = f"RefusedError {error.code}"
        except Exception as error:
            self.said = type(error).__name__

    def join(self) -> None:
        """Wait until the operator knows how it ended; kill a process that never will."""
        if self._thread is not None:
            self._thread.join(ENDS)
        if self._process is not None:
            try:
                out, _ = self._process.communicate(timeout=ENDS if self._process.poll() is not None else 4.0)
                done = self._process.returncode == 0 and json.loads(out or "{}").get("completed", False)
                self.said = "completed" if done else f"exit code {self._process.returncode}"
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.communicate()
                self.said = "never ended (frozen), killed"


class Rig:
    """A robot side that is kept as long as it lives, for one injection after the other."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.gate = gate()
        self._stack: ExitStack | None = None
        self.side: PandaSide

    def ready(self) -> CellClient:
        """A client of a robot side that is idle; starts another side when this one cannot be had."""
        for attempt in range(2):
            if self._stack is None:
                self._stack = ExitStack()
                self.side = self._stack.enter_context(panda_side(self.folder))
            try:
                for line in ("user_stop off", "freeze off", "gripper_silent off", "drop 0"):
                    self.side.box.faults.send(line)
                client = CellClient.connect(self.side.endpoint)
            except (StackError, OSError):
                self.close()
                continue
            try:
                if client.state().mode != "idle":
                    acknowledge(client)
                return client
            except StackError:
                client.close()
                self.close()
                if attempt:
                    raise
        raise RuntimeError("no robot side could be started twice")

    def close(self) -> None:
        """End the robot side."""
        if self._stack is not None:
            with contextlib.suppress(Exception):
                self._stack.close()
            self._stack = None


def inject(rig: Rig, kind: Kind, seed: int) -> Injection:
    """One injection."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    watcher = rig.ready()
    side = rig.side
    folder = Path(tempfile.mkdtemp(dir=rig.folder))
    trajectory = random_motion(watcher, rig.gate, rng, grip="gripper" in kind.name)
    link = FaultyLink(side.endpoint, seed)
    scene = Scene(
        side, rig.gate, watcher, None, link, trajectory, certified(trajectory, rig.gate), rng, {}, [link.close]
    )
    since = _milliseconds(side)
    note = ""
    operator = Operator(scene, kind.own_process, folder)
    try:
        scene.operator_pid = operator.pid
        wait_for_progress(watcher, int(rng.uniform(0.05, 0.7) * len(trajectory.q)))
        fault = _milliseconds(side)
        kind.inject(scene)
        operator.join()
    except (StackError, AssertionError, OSError, LookupError) as error:
        fault, note = _milliseconds(side), f"{type(error).__name__}: {str(error)[-300:]}"
        operator.join()
    _await_rest(side)
    time.sleep(STILL)
    try:
        history = side.history(folder)
    except StackError as error:
        raise RuntimeError(f"the simulated box itself is gone after '{kind.name}'") from error
    movement = judge_movement(history, since, fault, trajectory)
    arrived = bool(np.abs(history.q_d[-1] - trajectory.q[-1]).max() < 1e-9)
    mode = _mode(side)
    refused = scene.notes.get("refused")
    if movement.to_rest is None:
        outcome = "moving"
    elif mode == "idle" and arrived and operator.said == "completed":
        outcome = "refused" if "refused" in kind.expected and refused else "completed"
    else:
        outcome = "rests"
    for undo in scene.cleanup:
        undo()
    watcher.close()
    lines = list(read_audit_log(side.audit_log))
    readable = not any(isinstance(line, DamagedLine) and not line.last for line in lines)
    return Injection(
        kind=kind.name,
        seed=seed,
        outcome=outcome,
        said=operator.said,
        right=outcome in kind.expected and not note,
        uncertified=movement.uncertified,
        departure=movement.departure,
        to_rest=movement.to_rest,
        false_done=operator.said == "completed" and not arrived,
        log_readable=readable,
        refused=refused,
        note=note,
    )


def _milliseconds(side: PandaSide) -> int:
    return int(str(side.box.faults.send("state")["milliseconds"]))


def _await_rest(side: PandaSide) -> None:
    """Wait until the box is in no motion; one that never ends shows in the history."""
    until = time.monotonic() + REST
    while time.monotonic() < until and side.box.faults.send("state")["mode"] == "move":
        time.sleep(0.05)


def _mode(side: PandaSide) -> str:
    """Mode of the robot side, "gone" where there is none any more."""
    try:
        with CellClient.connect(side.endpoint, timeout=1.0) as client:
            return client.state().mode
    except StackError:
        return "gone"


def _work(jobs: list[tuple[int, int]], folder: str, results: Any) -> None:
    """One process's share of the injections."""
    rig, parent = Rig(Path(folder)), os.getppid()
    try:
        for kind, seed in jobs:
            if os.getppid() != parent:
                return  # nobody wants to know any more
            try:
                results.put(inject(rig, KINDS[kind], seed))
            except Exception as error:
                rig.close()
                name = KINDS[kind].name
                results.put(
                    Injection(name, seed, "broken", "", False, 0, 0.0, None, False, True, note=f"{error!r}"[:300])
                )
    finally:
        rig.close()


def summary(done: list[Injection]) -> dict[str, Any]:
    """The figures."""
    lost = {k.name for k in KINDS if k.loses_supervisor}
    after_loss = [d for d in done if d.kind in lost and d.to_rest is not None]
    return {
        "injections": len(done),
        "right": sum(d.right for d in done),
        "uncertified_motions": sum(d.uncertified > 0 for d in done),
        "false_done": sum(d.false_done for d in done),
        "unreadable_logs": sum(not d.log_readable for d in done),
        "still_moving": sum(d.outcome == "moving" for d in done),
        "broken": sum(d.outcome == "broken" for d in done),
        "loss_of_supervisor": {
            "injections": len(after_loss),
            "to_rest_s_max": max((d.to_rest or 0.0 for d in after_loss), default=None),
            "departure_mrad_max": max((1e3 * d.departure for d in after_loss), default=None),
        },
        "kinds": {
            k.name: {
                "injections": sum(d.kind == k.name for d in done),
                "right": sum(d.kind == k.name and d.right for d in done),
                "outcomes": dict(Counter(d.outcome for d in done if d.kind == k.name)),
                "said": dict(Counter(d.said for d in done if d.kind == k.name)),
                "to_rest_s_max": max((d.to_rest or 0.0 for d in done if d.kind == k.name), default=0.0),
            }
            for k in KINDS
            if any(d.kind == k.name for d in done)
        },
    }


def as_text(figures: dict[str, Any]) -> str:
    """As a table."""
    lines = [f"{'fault':<26}{'right':>10}  {'to rest, s':>10}  outcomes; what the operator was told"]
    for name, row in figures["kinds"].items():
        outcomes = ", ".join(f"{k} {v}" for k, v in row["outcomes"].items())
        said = ", ".join(f"{k} {v}" for k, v in row["said"].items())
        share = f"{row['right']}/{row['injections']}"
        lines.append(f"{name:<26}{share:>10}  {row['to_rest_s_max']:>10.2f}  {outcomes}; {said}")
    loss = figures["loss_of_supervisor"]
    lines += [
        "",
        f"{figures['injections']} injections, {figures['right']} as they have to be; uncertified motions "
        f"{figures['uncertified_motions']}, false reports of done {figures['false_done']}, unreadable logs "
        f"{figures['unreadable_logs']}, still moving {figures['still_moving']}, broken {figures['broken']}",
    ]
    if loss["to_rest_s_max"] is not None:
        lines.append(
            f"after loss of the supervisor: at rest within {loss['to_rest_s_max']:.2f} s, off the path by at most "
            f"{loss['departure_mrad_max']:.4f} mrad ({loss['injections']} injections)"
        )
    return "\n".join(lines)


def main() -> None:
    """Inject, and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--injections", type=int, default=308)
    parser.add_argument("--seed", type=int, default=0, help="of the first injection of each kind")
    parser.add_argument("--kinds", nargs="*", default=[], help="names of faults; default all")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    unknown = [k for k in given.kinds if k not in {kind.name for kind in KINDS}]
    if unknown:
        parser.error(f"there is no fault '{unknown[0]}'; there are: {', '.join(k.name for k in KINDS)}")
    chosen = [i for i, k in enumerate(KINDS) if not given.kinds or k.name in given.kinds]
    jobs = [(chosen[i % len(chosen)], given.seed + i // len(chosen)) for i in range(given.injections)]
    context = multiprocessing.get_context("spawn")
    results = context.Queue()
    with tempfile.TemporaryDirectory() as folder:
        workers = [
            context.Process(target=_work, args=(jobs[i :: given.jobs], folder, results)) for i in range(given.jobs)
        ]
        for worker in workers:
            worker.start()
        done: list[Injection] = []
        begun = time.monotonic()
        while len(done) < len(jobs):
            try:
                one = results.get(timeout=LOOK)
            except queue.Empty:
                if any(worker.exitcode for worker in workers):
                    for worker in workers:
                        worker.terminate()
                    sys.exit("a process that injects faults has ended; what it said stands above")
                continue
            done.append(one)
            spent = time.monotonic() - begun
            left = spent / len(done) * (len(jobs) - len(done)) / 60.0
            words = f"{one.outcome}, told '{one.said}'" + (f", {one.note}" if one.note else "")
            words += f", UNCERTIFIED {one.uncertified} rows, {one.departure:.3g} rad" if one.uncertified else ""
            print(
                f"[{spent:7.1f} s] {len(done)} of {len(jobs)}: {one.kind} {one.seed}: "
                f"{'right' if one.right else 'WRONG'} ({words}; {left:.0f} min left)",
                file=sys.stderr,
                flush=True,
            )
        for worker in workers:
            worker.join()
    figures = summary(done)
    if given.json:
        figures["wrong"] = [asdict(d) for d in done if not d.right]
        print(json.dumps(figures, indent=1))
    else:
        print(as_text(figures))


if __name__ == "__main__":
    main()
