"""Why a subtask failed, as data that planners can reason with. Needs the standard library only."""

from dataclasses import dataclass, field
from typing import Any, Literal

FailureKind = Literal[
    "no_candidate",
    "unsafe",
    "blocked_by",
    "locked",
    "not_seen",
    "lost_grasp",
    "tracking_error",
    "refused_by_robot",
    "reasoner_error",
    "not_achieved",
]


@dataclass(frozen=True)
class FailureCause:
    """One typed cause with its evidence.

    Attributes:
        kind: `no_candidate` no motion reaches the goal; `unsafe` a safety check failed; `blocked_by` bodies in the
            way; `locked` a joint that nothing explains; `not_seen` an object without a pose; `lost_grasp`;
            `tracking_error` measured and commanded motion parted; `refused_by_robot`; `reasoner_error`;
            `not_achieved` the motion was played as planned, yet the camera does not see its result.
        subject: The object or joint that the subtask was about.
        bodies: Objects to blame, for `blocked_by`; else empty.
        check: Name of the safety check, for `unsafe`; else None.
        message: One sentence for people, about objects.
        evidence: Numbers behind it (counts of candidates by reason, forces in [N], distances in [m]).
    """

    kind: FailureKind
    subject: str
    message: str
    bodies: tuple[str, ...] = ()
    check: str | None = None
    evidence: dict[str, Any] = field(default_factory=dict)
