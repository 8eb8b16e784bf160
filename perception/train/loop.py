"""The loop that both trainings run: draw, step, keep a running mean, say how it goes, save, go on later."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from perception.detection.devices import load_package
from perception.train.checkpoints import load_checkpoint, save_checkpoint
from perception.train.schedule import MeanWeights, rate

EVERY = 50  # steps between two lines of progress
SMOOTH = 0.98  # of the figures in them


@dataclass(frozen=True)
class TrainingSettings:
    """What both trainings need to know.

    Attributes:
        steps: Planned number of steps.
        learning_rate: Full rate.
        seed: Of the randomness of every step.
        save_every: Steps between checkpoints.
    """

    steps: int
    learning_rate: float
    seed: int
    save_every: int


def run_training(
    checkpoint: Path,
    model: Any,
    weights: Iterable[Any],
    optimiser: Any,
    further: dict[str, Any],
    loss_of: Callable[[np.random.Generator], tuple[Any, dict[str, float]]],
    between: Callable[[], None],
    settings: TrainingSettings,
    say: Callable[[str], None],
    prepare: Callable[[Any], None] = lambda model: None,
) -> Any:
    """Train until the planned number of steps, from where the checkpoint stands.

    Args:
        checkpoint: File; read at the start, written every so many steps, and when interrupted.
        model: The network.
        weights: All that is learned.
        optimiser: Of these weights.
        further: What else belongs into the checkpoint, by name.
        loss_of: Draws a batch with the given generator; gives its loss and figures to show.
        between: Called after every checkpoint, for instance to read further pictures.
        settings: Of the loop.
        say: Progress.
        prepare: Called with the network once its running mean has been set apart.

    Returns:
        The network with the running mean of the weights.

    Raises:
        FrameError: A checkpoint of another network, or damaged pictures.
        KeyboardInterrupt: After the checkpoint has been saved.
    """
    torch = load_package("torch")
    weights = list(weights)
    mean = MeanWeights(model)
    parts = {"model": model, "mean": mean.model, "optimiser": optimiser, **further}
    step, spent = load_checkpoint(checkpoint, parts)
    say(f"{sum(p.numel() for p in model.parameters()) / 1e6:.2f} M parameters, from step {step}")
    prepare(model)
    model.train()
    started = time.monotonic()
    shown: dict[str, float] = {}
    try:
        while step < settings.steps:
            for group in optimiser.param_groups:
                group["lr"] = settings.learning_rate * rate(step, settings.steps)
            # A generator of its own for each step, so that a training that was interrupted goes on alike.
            loss, figures = loss_of(np.random.default_rng((settings.seed, step)))
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            torch.nn.utils.clip_grad_norm_(weights, 1.0)
            optimiser.step()
            mean.update(model, step)
            step += 1
            shown = {k: SMOOTH * shown.get(k, v) + (1 - SMOOTH) * v for k, v in figures.items()}
            if step % EVERY == 0:
                minutes = (spent + time.monotonic() - started) / 60.0
                text = ", ".join(f"{k} {v:.3f}" for k, v in shown.items())
                say(f"step {step} of {settings.steps}, {minutes:.1f} min, {text}")
            if step % settings.save_every == 0:
                save_checkpoint(checkpoint, parts, step, spent + time.monotonic() - started)
                between()
    finally:
        save_checkpoint(checkpoint, parts, step, spent + time.monotonic() - started)
    return mean.model
