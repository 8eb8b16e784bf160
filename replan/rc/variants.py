"""Variants of the method, as data: what is left out, what replaces it, what it is given."""

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

from control.errors import ConfigError
from planning.baselines import METHODS
from planning.loop.results import Part

BASELINES = tuple(name for name in METHODS if name != "replan")


@dataclass(frozen=True)
class Variant:
    """What an episode is run with; the fields are those of `replan.run.options.RunOptions`.

    Attributes:
        name: For people, and in files.
    """

    name: str
    without: tuple[str, ...] = ()
    method: str = "replan"
    poses: Literal["seen", "true"] = "seen"
    answer_noise: float = 0.0

    def as_json(self) -> dict[str, Any]:
        """As one JSON object."""
        return {
            "name": self.name,
            "without": list(self.without),
            "method": self.method,
            "poses": self.poses,
            "answer_noise": self.answer_noise,
        }

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> "Variant":
        """What `as_json` wrote."""
        return cls(data["name"], tuple(data["without"]), data["method"], data["poses"], data["answer_noise"])


_NAMED = {
    "full": Variant("full"),
    **{f"no-{part}": Variant(f"no-{part}", without=(part,)) for part in get_args(Part)},
    **{method: Variant(method, method=method) for method in BASELINES},
}


def variant_from(text: str, poses: Literal["seen", "true"] = "seen", answer_noise: float = 0.0) -> Variant:
    """The variant that a word names: a name, then `+true-poses` and `+answer-noise=SHARE` as wanted.

    Args:
        text: For instance "full", "no-verifier" or "full+true-poses+answer-noise=0.1".
        poses, answer_noise: For every variant that does not say it itself.

    Raises:
        ConfigError: It names none.
    """
    name, *extras = text.split("+")
    if name not in _NAMED:
        raise ConfigError(f"the benchmark has no variant '{name}'; it has: {', '.join(_NAMED)}")
    variant = _NAMED[name]
    variant = replace(variant, poses=poses, answer_noise=answer_noise)
    for extra in extras:
        word, _, value = extra.partition("=")
        if extra == "true-poses":
            variant = replace(variant, poses="true")
        elif word == "answer-noise":
            variant = replace(variant, answer_noise=_share(value))
        else:
            raise ConfigError(f"variant '{text}': '{extra}' is not known; there are: true-poses, answer-noise=SHARE")
    if not 0.0 <= variant.answer_noise <= 1.0:
        raise ConfigError(f"answer noise is a share from 0 to 1, not {variant.answer_noise:g}")
    tail = "+true-poses" if variant.poses == "true" else ""
    tail += f"+answer-noise={variant.answer_noise:g}" if variant.answer_noise else ""
    return replace(variant, name=name + tail)


def _share(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ConfigError(f"answer noise is a share from 0 to 1, not '{text}'") from None
