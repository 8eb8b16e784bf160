"""Turning simulated states into what residuals read: where things were, and which contacts had how much force.

Contacts are recomputed from recorded states (`mj_forward`), only for motions that are worth it and at a stride.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from control.path_planning.collision_filter import body_name, subtree_root
from control.path_planning.planning_context import resting_on
from control.safety.residuals import Contacts, HeldSpan, TwinMotion
from control.safety.zones import RobotPoints, RobotTrack
from control.simulation.rollouts import Rollout
from control.tasks.reward_spec import RewardSpec
from control.tasks.subtasks import read_subtask
from control.twin_model import ARM_BODIES, FINGER_BODIES, HAND_BODY, TABLE_BODY, TCP_SITE, TwinModel

FORCE_FLOOR = 0.05  # [N]: weaker contacts are not recorded
POSES = ("xpos", "xmat", "site_xpos", "site_xmat", "geom_xpos", "geom_xmat")  # fields of MjData


@dataclass(frozen=True)
class Purpose:
    """What a motion is for, as far as safety depends on it: who may be touched, held and moved.

    Attributes:
        named: Objects and joints that may be moved.
        subject: The object that is handled, or None.
        supports: Bodies that may carry what is handled.
        releases: Whether the subject has to be let go at the end.
        handled: Objects and joints that may be touched beside the subject.
    """

    named: frozenset[str] = frozenset()
    subject: str | None = None
    supports: frozenset[str] = frozenset({TABLE_BODY})
    releases: bool = False
    handled: frozenset[str] = frozenset()

    @classmethod
    def of_spec(cls, spec: RewardSpec, carriers: Iterable[str] = ()) -> "Purpose":
        """What a reward spec asks for.

        Args:
            spec: Of the subtask.
            carriers: What carries the handled object at the start.
        """
        task = read_subtask(spec)
        own = frozenset({task.subject} if task.subject else ())
        return cls(
            named=spec.names | own,
            subject=task.subject,
            supports=frozenset(carriers) | {TABLE_BODY} | (spec.names - own),
            releases=task.releases,
        )

    @classmethod
    def in_twin(cls, twin: TwinModel, spec: RewardSpec | None, handled: frozenset[str] = frozenset()) -> "Purpose":
        """The purpose of a motion that starts where a twin is.

        Args:
            twin: For what carries the handled objects at the start.
            spec: What is to be achieved, or None where nothing is known but who may be handled.
            handled: Objects and joints that may be touched, held and moved beside those of the spec.
        """
        start = twin.start()
        carriers = {c for name in handled for c in resting_on(twin.model, start, name)}
        if spec is None:
            return cls(handled, None, frozenset(carriers) | {TABLE_BODY}, False, handled)
        subject = read_subtask(spec).subject or twin.held
        carriers |= resting_on(twin.model, start, subject) if subject else set()
        own = cls.of_spec(spec, carriers)
        return replace(own, named=own.named | handled, handled=handled)


def record_motion(rollout: Rollout, twin: TwinModel, purpose: Purpose, stride: int) -> TwinMotion:
    """Turn recorded states into what residuals read.

    Args:
        rollout: One simulated motion.
        twin: The twin that it was simulated in.
        purpose: Who may be handled.
        stride: Look at every `stride`-th state (and the last).
    """
    model, data = rollout.model, mujoco.MjData(rollout.model)
    rows = np.unique(np.append(np.arange(0, len(rollout.time), stride), len(rollout.time) - 1))
    bodies = {o.name: model.body(o.name).id for o in twin.objects}
    moving = [model.body(j.body).id for j in twin.joints]
    followed = np.array([*bodies.values(), *moving], int)
    names = contact_names(model, frozenset(bodies) | {j.body for j in twin.joints})
    # Contacts between things at rest on each other are nobody's business and most of the work.
    acting = frozenset({*ARM_BODIES, HAND_BODY, *FINGER_BODIES, *purpose.handled, purpose.subject or ""})
    touched = _Touched(names, acting)
    # All poses are kept as they come: what is made of them is cheaper for all rows together.
    went = {name: np.empty((len(rows), *getattr(data, name).shape)) for name in POSES}
    copies = [(went[name], getattr(data, name)) for name in POSES]
    qpos, qvel, ctrl = data.qpos, data.qvel, data.ctrl
    states = zip(rollout.qpos[rows], rollout.qvel[rows], rollout.ctrl[rows], strict=True)
    for k, state in enumerate(states):
        qpos[:], qvel[:], ctrl[:] = state
        mujoco.mj_forward(model, data)
        for into, now in copies:
            into[k] = now
        touched.add(data)
    site = model.site(TCP_SITE).id
    tcp = _poses(went["site_xpos"][:, site], went["site_xmat"][:, site])
    places = [_poses(went["xpos"][:, body], went["xmat"][:, body]) for body in followed.tolist()]
    handles = {
        j.name: place[:, :3, 3] + place[:, :3, :3] @ j.handle.centre
        for j, place in zip(twin.joints, places[len(bodies) :], strict=True)
    }
    robot = RobotPoints(model)
    track = robot.along(went["geom_xpos"], went["geom_xmat"], went["site_xpos"])
    return TwinMotion(
        time=rollout.time[rows],
        tcp=tcp,
        objects=dict(zip(bodies, places, strict=False)),
        contacts=touched.contacts(),
        held=tuple(
            HeldSpan(s.name, int(np.searchsorted(rows, s.start)), int(np.searchsorted(rows, s.stop)))
            for s in rollout.commands.held
        ),
        # What is in the hand moves with it by right.
        named=purpose.named | {s.name for s in rollout.commands.held},
        subject=purpose.subject,
        handled=purpose.handled,
        # A motion's own word counts only for what it may move.
        grasped=frozenset(s.name for s in rollout.commands.handled) & purpose.named,
        supports=purpose.supports,
        expects_release=purpose.releases,
        fractions={
            j.name: np.array([j.fraction(x) for x in rollout.qpos[rows, model.joint(j.name).qposadr[0]]])
            for j in twin.joints
        },
        handles=handles,
        robot=RobotTrack(robot.bodies, robot.radius, track),
    )


class _Touched:
    """Collects contacts state by state as MuJoCo keeps them and reads them all together: far cheaper than one by one.

    Args:
        names: For each geom the name that its contacts are reported under.
        acting: Names of which a contact needs one to be kept.
    """

    def __init__(self, names: list[str], acting: frozenset[str]) -> None:
        self._known, self._code = np.unique(np.array(names), return_inverse=True)
        self._acts = np.array([name in acting for name in names])
        self._geoms, self._addresses, self._dims = [], [], []
        self._rows: list[np.ndarray] = []

    def add(self, data: mujoco.MjData) -> None:
        """Keep the contacts of the next state; forces must be up to date."""
        contact = data.contact
        self._geoms.append(contact.geom.copy())
        self._addresses.append(contact.efc_address.copy())
        self._dims.append(contact.dim.copy())
        self._rows.append(data.efc_force.copy())

    def contacts(self) -> Contacts:
        """What was kept, without contacts that are weaker than `FORCE_FLOOR`; a step is the number of a state.

        With elliptic friction cones, which our robots' models have, the first rows of a contact's constraint force are
        its normal and its two tangential forces (MuJoCo documentation, "Computation", section "Contact").
        """
        counts = [len(a) for a in self._addresses]
        step = np.repeat(np.arange(len(counts)), counts)
        geoms, address = np.concatenate(self._geoms).reshape(-1, 2), np.concatenate(self._addresses)
        first = np.cumsum([0, *(len(r) for r in self._rows)])[:-1]
        code = self._code[geoms]
        # A contact that takes part in no constraint has no address.
        kept = np.flatnonzero(self._acts[geoms].any(axis=1) & (code[:, 0] != code[:, 1]) & (address >= 0))
        step, code, at = step[kept], code[kept], first[step[kept]] + address[kept]
        sliding = np.concatenate(self._dims)[kept] > 1
        rows = np.concatenate([*self._rows, np.zeros(2)])  # two more, for a last contact without friction
        x, y, z = rows[at], np.where(sliding, rows[at + 1], 0.0), np.where(sliding, rows[at + 2], 0.0)
        force = np.sqrt(x * x + y * y + z * z)
        felt = np.flatnonzero(force > FORCE_FLOOR)
        own, pair = np.unique(code[felt, 0] * len(self._known) + code[felt, 1], return_inverse=True)
        first_name, second_name = self._known[own // len(self._known)], self._known[own % len(self._known)]
        pairs = tuple(zip(first_name.tolist(), second_name.tolist(), strict=True))
        return Contacts(step[felt], pairs, pair, force[felt])


def contact_names(model: mujoco.MjModel, objects: frozenset[str]) -> list[str]:
    """For each geom the name that contacts are reported under: a robot link, an object, a door, the table."""
    robot = {*ARM_BODIES, HAND_BODY, *FINGER_BODIES}
    out = []
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        name = body_name(model, body)
        if name not in robot and name not in objects:
            root = body_name(model, subtree_root(model, body))
            name = root if root in objects else name
        out.append(name)
    return out


def _poses(position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Poses, shape (n, 4, 4), from positions (n, 3) and rotation matrices as MuJoCo keeps them (n, 9)."""
    out = np.tile(np.eye(4), (len(position), 1, 1))
    out[:, :3, :3], out[:, :3, 3] = rotation.reshape(-1, 3, 3), position
    return out
