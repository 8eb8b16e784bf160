"""Rights over a link between machines, by the role in a certificate's common name; enforced by whoever listens.

Nothing passes but what is listed here: a new key under `cell/` is open to operators' questions, and closed to cameras
and viewers until it is added.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import zenoh

from hw_interface.link.security import Role

# Kinds of message of the transport's access control.
_ASK = ("query",)
_ANSWER = ("declare_queryable", "reply")
_PUBLISH = ("put", "delete")
_LISTEN = ("declare_subscriber",)
_BE_SEEN = ("liveliness_token",)
_WATCH = ("liveliness_query", "declare_liveliness_subscriber")
_ALL = (*_ASK, *_ANSWER, *_PUBLISH, *_LISTEN, *_BE_SEEN, *_WATCH)

_EVERYTHING = ("cell/**",)
_READABLE = (
    "cell/info",
    "cell/state",
    "cell/clock",
    "cell/frame/**",
    "cell/result",
    "cell/camera/**",
    "cell/camera_health/**",
    "cell/executing",
    "cell/alive",
)
_ROS2 = ("**", "@ros2_lv/**", "@/*/@ros2_lv", "@/*/@ros2_lv/**")  # its topics have keys of their own


@dataclass(frozen=True)
class _Right:
    """What one side may do: kinds of message on keys. What is not allowed counts more than what is."""

    messages: tuple[str, ...]
    keys: tuple[str, ...]
    allowed: bool = True


# What the holders of a certificate may send to the session that listens, and what it may send to them. Whatever is in
# neither list does not pass.
_FROM: Mapping[Role, tuple[_Right, ...]] = {
    "robot": (_Right(_ALL, _EVERYTHING),),
    "camera": (
        _Right(_ANSWER, ("cell/frame/**", "cell/camera_health/**")),
        _Right(_BE_SEEN, ("cell/camera/**",)),
        _Right(_PUBLISH, ("cell/camera_health/**",)),
        # A camera on the hand moves with the arm, and pictures are stamped on the robot's clock.
        _Right((*_ASK, *_LISTEN), ("cell/info", "cell/state", "cell/clock")),
        _Right(_WATCH, _EVERYTHING),
    ),
    "operator": (
        _Right((*_ASK, *_LISTEN, *_WATCH), _EVERYTHING),
        _Right(_BE_SEEN, ("cell/operator/**",)),
        _Right(_PUBLISH, ("cell/operator_beat/**",)),
    ),
    "viewer": (
        _Right((*_ASK, *_LISTEN), _READABLE),
        _Right(_ASK, ("cell/stop",)),
        _Right(_WATCH, _EVERYTHING),
    ),
    # The view that publishes, and ROS 2's own bridges and nodes that read it: nothing of the cell can be moved.
    "ros2": (
        _Right((*_ANSWER, *_PUBLISH, *_LISTEN, *_BE_SEEN, *_WATCH), _ROS2),
        _Right(_ASK, (*_READABLE, "**/@adv/**")),  # what a topic's publisher keeps for those who come later
        _Right((*_ANSWER, *_PUBLISH, *_BE_SEEN), _EVERYTHING, allowed=False),
    ),
}
_TO: Mapping[Role, tuple[_Right, ...]] = {
    "robot": (_Right(_ALL, _EVERYTHING),),
    "camera": (
        _Right((*_ASK, *_LISTEN, *_WATCH), ("cell/frame/**", "cell/camera/**", "cell/camera_health/**")),
        _Right((*_ANSWER, *_PUBLISH), ("cell/info", "cell/state", "cell/clock")),
        _Right(_BE_SEEN, _EVERYTHING),
    ),
    "operator": (_Right((*_ANSWER, *_PUBLISH, *_BE_SEEN, *_WATCH, *_LISTEN), _EVERYTHING),),
    "viewer": (
        _Right((*_ANSWER, *_PUBLISH), (*_READABLE, "cell/stop")),
        _Right((*_BE_SEEN, *_WATCH, *_LISTEN), _EVERYTHING),
    ),
    "ros2": (_Right(_ALL, _ROS2),),
}


def may_ask(role: Role, key: str) -> bool:
    """Whether this role may put questions to this key."""
    return any(
        zenoh.KeyExpr(keys).includes(zenoh.KeyExpr(key))
        for right in _FROM.get(role, ())
        if right.allowed and set(_ASK) <= set(right.messages)
        for keys in right.keys
    )


def access_rules() -> dict[str, Any]:
    """Access control of a session that listens: nothing passes but what the roles above say."""
    rules, policies = [], []
    for role in _FROM:
        ids = []
        for flow, table in (("ingress", _FROM), ("egress", _TO)):
            for i, right in enumerate(table[role]):
                ids.append(f"{role}-{flow}-{i}")
                rules.append(
                    {
                        "id": ids[-1],
                        "permission": "allow" if right.allowed else "deny",
                        "flows": [flow],
                        "messages": list(right.messages),
                        "key_exprs": list(right.keys),
                    }
                )
        policies.append({"rules": ids, "subjects": [role]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": role, "cert_common_names": [role]} for role in _FROM],
        "policies": policies,
    }
