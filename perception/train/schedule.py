"""How fast to learn, and the running mean of the weights that is kept in the end."""

import copy
from typing import Any

from perception.detection.devices import load_package


def rate(step: int, total: int, warm_up: int = 300, cool_down: float = 0.5, least: float = 0.02) -> float:
    """Share of the full learning rate at a step: a rise, a plateau, and a straight fall over the last part.

    The plateau does not depend on the total, so a training may be cut short or made longer after the fact.

    Args:
        step: Counted from 0.
        total: Planned number of steps.
        warm_up: Steps of the rise.
        cool_down: Share of the steps over which it falls.
        least: Share at the end.
    """
    falling = (total - step) / max(cool_down * total, 1.0)
    return max(least, min(1.0, (step + 1) / warm_up, falling))


class MeanWeights:
    """Exponential running mean of a model's weights.

    Attributes:
        model: A copy that holds the mean.
    """

    def __init__(self, model: Any, decay: float = 0.998) -> None:
        self.model = copy.deepcopy(model).eval()
        self._decay = decay

    def update(self, model: Any, step: int) -> None:
        """Move towards the model's weights; faster in the beginning, when the mean still holds the start."""
        torch = load_package("torch")
        decay = min(self._decay, (1.0 + step) / (10.0 + step))
        with torch.no_grad():
            for mean, now in zip(self.model.parameters(), model.parameters(), strict=True):
                mean.lerp_(now, 1.0 - decay)
            for mean, now in zip(self.model.buffers(), model.buffers(), strict=True):
                mean.copy_(now)
