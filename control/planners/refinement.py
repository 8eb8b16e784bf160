"""Variants of motions that almost worked: the hand's poses shifted by millimetres and a few degrees, filtered again."""

from dataclasses import replace

import numpy as np

from control.path_planning.collision_filter import Phase
from control.path_planning.planning_context import PlanningContext
from control.planners.candidates import Candidate
from control.trajectory.samples import PathSegment

SHIFT = 0.006  # [m], standard deviation of a shift of the whole grasp
TURN = 0.05  # [rad]
GRASPED = ("approach", "lift", "drive")
PLACED = ("lower", "retreat")


def vary(context: PlanningContext, elite: list[Candidate], count: int) -> list[Candidate]:
    """Up to `count` variants of the best candidates, which keep to the geometric filter.

    Grasp and release move together by one shift each, in the frame of the world; segments between them follow.

    Args:
        context: Surroundings of the search.
        elite: Candidates to vary, best first.
        count: Most variants to return.
    """
    out: list[Candidate] = []
    for attempt in range(2 * count):
        if len(out) >= count or not elite:
            break
        variant = _variant(context, elite[attempt % len(elite)])
        if variant is not None:
            out.append(variant)
    return out


def _variant(context: PlanningContext, candidate: Candidate) -> Candidate | None:
    grasp_shift, place_shift = context.rng.normal(0, SHIFT, 3), context.rng.normal(0, SHIFT, 3)
    if any(s.name == "drive" for s in candidate.segments):  # what is let go is where the handle is
        place_shift = grasp_shift
    segments: list[PathSegment] = []
    last = candidate.segments[0].q[0]
    for segment in candidate.segments:
        shift = grasp_shift if segment.name in GRASPED else place_shift if segment.name in PLACED else None
        if shift is None:
            segments.append(segment)
            continue
        targets = np.stack([context.filter.tcp_pose(q) for q in segment.q])
        targets[:, :3, 3] += shift
        rows, q = context.solve_from(targets, segment.q)
        if len(rows) != len(targets):
            return None
        width = context.twin.gripper_width if segment.gripper is None else segment.gripper.width
        if segment.name == "approach" and not context.filter.path_clear(
            q, Phase.GRASP, max(width, context.twin.gripper_width)
        ):
            return None
        segments.append(replace(segment, q=q))
    joined = _joined(segments, last)
    return Candidate(joined, f"{candidate.description}, varied", candidate.preference)


def _joined(segments: list[PathSegment], start: np.ndarray) -> tuple[PathSegment, ...]:
    """Blend the ends of untouched segments into their shifted neighbours, so that the path stays in one piece."""
    out: list[PathSegment] = []
    for i, segment in enumerate(segments):
        q = segment.q.copy()
        first = start if not out else out[-1].q[-1]
        shifted_next = i + 1 < len(segments) and segments[i + 1].name in (*GRASPED, *PLACED)
        last = segments[i + 1].q[0] if shifted_next and segment.name not in (*GRASPED, *PLACED) else q[-1]
        blend = np.linspace(0.0, 1.0, len(q))[:, None]
        q = q + (1 - blend) * (first - q[0]) + blend * (last - q[-1])
        out.append(replace(segment, q=q))
    return tuple(out)
