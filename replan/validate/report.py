"""One self-contained HTML page about a judged motion: verdict, checks, plots, pictures of the worst moments."""

import copy
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from control.errors import MachineError
from control.safety.trajectory_checks import hand_velocities
from control.trajectory.samples import SAMPLE_TIME
from control.twin_model import ARM_BODIES, FINGER_BODIES, HAND_BODY, TABLE_BODY, TwinModel
from replan.reports.pages import jpeg_text, made_by, write_page
from replan.validate.motion import Validation
from replan.validate.plots import PART_NAMES, clearance_svg, hand_svg, joint_quantities, joints_svg
from replan.validate.text import NOT_LOOKED, check_rows, hints, summary, trials_text
from sim_check.models.render import FreeView, Offscreen

WIDTH, HEIGHT = 560, 420  # [px] of a picture
MOST_PICTURES = 6  # of broken checks
LEAST_PICTURES = 3
SAME_MOMENT = 0.05  # [s]: checks that are worst together share a picture
BLAMED = np.array([0.85, 0.15, 0.12, 1.0])  # colour of the bodies of a broken check
NEAREST = np.array([0.95, 0.62, 0.10, 1.0])  # of those that only come nearest
ROBOT = np.array([0.80, 0.84, 0.88, 1.0])


@dataclass(frozen=True)
class Moment:
    """A moment that is worth a picture.

    Attributes:
        time: In [s].
        title, text: What it shows.
        bodies: Who takes part.
        broken: Whether a check is broken there.
    """

    time: float
    title: str
    text: str
    bodies: tuple[str, ...]
    broken: bool


@dataclass(frozen=True)
class Picture:
    """A picture for the page: JPEG as base64 text."""

    title: str
    text: str
    broken: bool
    data: str


def write_report(validation: Validation, path: Path, footer_text: str) -> None:
    """Write the page.

    Args:
        validation: What was judged.
        path: Where to; its folder is made when absent.
        footer_text: Who made it and when, for the last line; see `footer`.

    Raises:
        ConfigError: The file cannot be written.
    """
    write_page("validation.html.j2", _content(validation, footer_text), path)


def footer() -> str:
    """Who made a report, and when."""
    return made_by(f"MuJoCo {mujoco.__version__}")


def _content(validation: Validation, footer_text: str) -> dict:
    v, t = validation, validation.trajectory
    moments = worst_moments(v)
    try:
        pictures = _pictures(v, moments)
        notes = []
    except MachineError as error:
        pictures, notes = [], [("pictures", f"none: {error}")]
    if v.judgement.unseen is None:
        notes.append(("unseen space", NOT_LOOKED))
    motion = v.judgement.motion
    clearances = motion.clearances if motion is not None else None
    linear, angular = hand_velocities(v.robot.tcp_poses(t.q))
    quantities = joint_quantities(t, v.limits, v.safety, v.torque)
    stretches = [(s.name, s.stop * SAMPLE_TIME) for s in t.segments]
    broken = any(m.broken for m in moments)
    return {
        "passed": v.verdict.passed,
        "summary": summary(v),
        "motion": {"name": v.options.file.name, "description": motion_text(v)},
        "robot": f"{v.limits.profile}, {v.cell.robot.gripper_model.name}",
        "scene": {"cell": v.cell.name, "description": scene_text(v)},
        "trials": trials_text(v),
        "tried": v.options.perturbed > 0,
        "notes": notes,
        "hints": hints(v),
        "rows": check_rows(v),
        "pictures": pictures,
        "pictures_title": "Worst moments" if broken else "Nearest moments",
        "clearances": clearance_svg(clearances, motion.time, v.safety) if motion and clearances else "",
        "hand": hand_svg(np.linalg.norm(linear, axis=1), np.linalg.norm(angular, axis=1), v.safety),
        "joints": joints_svg(quantities, t.joint_names, stretches),
        "footer": footer_text,
    }


def motion_text(validation: Validation) -> str:
    """The motion in one line."""
    t = validation.trajectory
    parts = [f"{t.duration:.2f} s, {len(t.q)} samples", validation.motion.source, validation.made]
    return "; ".join([*parts, *validation.motion.notes])


def scene_text(validation: Validation) -> str:
    """The scene in one line."""
    return f"cell {validation.cell.name}: {', '.join(validation.scene.names)} ({validation.scene.source})"


def worst_moments(validation: Validation) -> list[Moment]:
    """Broken checks in order of time; where there are few of them, the nearest clearances too."""
    moments: list[Moment] = []
    rows = {row.name: row for row in check_rows(validation)}
    failed = [c for c in validation.verdict.checks if not c.ok and c.at is not None]
    for check in sorted(failed, key=lambda c: c.at or 0.0):
        row = rows[check.name]
        text = f"{row.worst} {row.unit} at {row.at} (limit {row.limit})" + (f": {row.bodies}" if row.bodies else "")
        moments.append(Moment(float(check.at or 0.0), check.name, text, check.bodies, True))
    merged: list[Moment] = []
    for m in moments:
        if merged and m.time - merged[-1].time < SAME_MOMENT:
            last = merged[-1]
            bodies = tuple(dict.fromkeys((*last.bodies, *m.bodies)))
            merged[-1] = Moment(last.time, f"{last.title}, {m.title}", f"{last.text}; {m.text}", bodies, True)
        else:
            merged.append(m)
    return merged[:MOST_PICTURES] + _nearest(validation)[: max(0, LEAST_PICTURES - len(merged))]


def _nearest(validation: Validation) -> list[Moment]:
    """Where each part comes nearest to what it may not touch, nearest first."""
    motion = validation.judgement.motion
    if motion is None or motion.clearances is None or not len(motion.clearances.step):
        return []
    out = []
    c = motion.clearances
    broken = {check.name for check in validation.verdict.failed_checks}
    for part, distance in c.distance.items():
        k = int(np.argmin(distance))
        if not np.isfinite(distance[k]) or f"{part}_clearance" in broken:
            continue
        bodies = (*(FINGER_BODIES if part == "finger" else ()), c.nearest[part][k])
        time = float(motion.time[c.step[k]])
        text = f"{1e3 * distance[k]:.1f} mm at {time:.3f} s to {bodies[-1]}"
        out.append((float(distance[k]), Moment(time, f"nearest, {PART_NAMES[part]}:", text, bodies, False)))
    return [m for _, m in sorted(out, key=lambda pair: pair[0])]


def _pictures(validation: Validation, moments: list[Moment]) -> list[Picture]:
    rollout, twin = validation.judgement.rollout, validation.twin
    out = []
    for moment in moments:
        row = min(int(np.searchsorted(rollout.time, moment.time)), len(rollout.qpos) - 1)
        qpos = rollout.qpos[row]
        if not np.all(np.isfinite(qpos)):
            continue
        out.append(Picture(moment.title, moment.text, moment.broken, jpeg_text(_picture(twin, qpos, moment))))
    return out


def _picture(twin: TwinModel, qpos: np.ndarray, moment: Moment) -> np.ndarray:
    """The twin at one moment with the bodies that take part in colour, seen from where they are in the middle."""
    model = copy.copy(twin.model)
    bodies = [
        b for b in moment.bodies if b != TABLE_BODY and mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, b) >= 0
    ]
    colours = dict.fromkeys((*ARM_BODIES, HAND_BODY, *FINGER_BODIES), ROBOT)
    colours |= dict.fromkeys(bodies, BLAMED if moment.broken else NEAREST)
    for name, colour in colours.items():
        of_body = model.geom_bodyid == model.body(name).id
        model.geom_rgba[of_body] = colour
        model.geom_matid[of_body] = -1
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    middle = np.mean([data.body(name).xipos for name in bodies or (HAND_BODY,)], axis=0)
    view = FreeView(
        look_at=(float(middle[0]), float(middle[1]), float(middle[2])),
        distance=0.8,
        azimuth_deg=140.0,
        elevation_deg=-18.0,
    )
    with Offscreen(model, WIDTH, HEIGHT, collision=True) as renderer:
        return renderer.colour(data, view, WIDTH, HEIGHT)
