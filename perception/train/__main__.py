"""Train the bundled detector and segmenter, on two CPU cores and without a network connection.

    python -m perception.train                     # render pictures, train both, write weights
    python -m perception.train detector --steps 30000
    python -m perception.train publish             # measure what was trained and make it the bundled weights

It goes on where it was interrupted. Pictures are rendered by a process of their own
(`sim_check.random_scenes.labelled_pictures`) while training runs on those that are there.
"""

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from perception.errors import PerceptionError
from replan_base.processes import python_module

FIRST_SHARDS = 4  # training waits for these
HELD_OUT = 1_000_000  # shards from this seed on are never trained on


def main() -> int:
    """Parse, render, train. Returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m perception.train", description="Train the bundled detector and segmenter."
    )
    parser.add_argument("what", nargs="?", choices=("detector", "segmenter", "both", "publish"), default="both")
    parser.add_argument("--folder", type=Path, default=Path("runs/training"), help="shards, checkpoints and results")
    parser.add_argument("--shards", type=int, default=160, help="shards of 200 pictures to render, 6 MB each")
    parser.add_argument("--steps", type=int, default=12_000, help="steps of the detector")
    parser.add_argument("--segmenter-steps", type=int, default=12_000, help="steps of the segmenter")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--to", type=Path, default=Path("perception/weights"), help="where `publish` writes")
    parser.add_argument("--threads", type=int, default=1, help="of torch; one leaves a core to the rendering")
    args = parser.parse_args()
    # Waiting threads must not spin while the rendering needs the core.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    os.environ.setdefault("OMP_NUM_THREADS", str(args.threads))
    for number in (signal.SIGINT, signal.SIGTERM):  # also in the background, where shells let SIGINT be ignored
        signal.signal(number, signal.default_int_handler)
    try:
        if args.what == "publish":
            _publish(args)
            return 0
        with _rendering(args.folder / "shards", args.shards):
            _train(args)
    except PerceptionError as error:
        _say(str(error))
        return 1
    except KeyboardInterrupt:
        _say("interrupted; the same command goes on from the last checkpoint")
        return 130
    return 0


def _train(args: argparse.Namespace) -> None:
    import cv2

    from perception.detection.devices import load_package

    load_package("torch").set_num_threads(args.threads)
    cv2.setNumThreads(1)
    folder = args.folder / "shards"

    def paths() -> list[Path]:
        return sorted(p for p in folder.glob("shard_*.npz") if int(p.stem.split("_")[1]) < HELD_OUT)

    while len(paths()) < min(FIRST_SHARDS, args.shards):
        time.sleep(2.0)
    if args.what in ("detector", "both"):
        from perception.train.detector import DetectorTraining, train_detector

        out = train_detector(args.folder, paths, DetectorTraining(steps=args.steps, seed=args.seed), _say)
        _say(f"detector written to {out}")
    if args.what in ("segmenter", "both"):
        from perception.train.segmenter import SegmenterTraining, train_segmenter

        steps = args.segmenter_steps
        out = train_segmenter(args.folder, paths, SegmenterTraining(steps=steps, seed=args.seed), _say)
        _say(f"segmenter written to {out}")


def _publish(args: argparse.Namespace) -> None:
    """Measure what was trained on pictures that were never trained on, and write weights and cards."""
    from datetime import date

    from perception.detection.devices import load_package
    from perception.train.publish import publish_detector, publish_segmenter
    from perception.train.shards import Shards

    torch = load_package("torch")
    torch.set_num_threads(args.threads)
    shards = args.folder / "shards"
    command = python_module("sim_check.random_scenes.labelled_pictures", "--out", str(shards))
    subprocess.run([*command, "--first", str(HELD_OUT), "--shards", "2"], check=True)
    held_out = Shards([p for p in sorted(shards.glob("shard_*.npz")) if int(p.stem.split("_")[1]) >= HELD_OUT])
    pictures = 200 * (len(list(shards.glob("shard_*.npz"))) - 2)
    for what, publish in (("detector", publish_detector), ("segmenter", publish_segmenter)):
        trained, checkpoint = args.folder / what, args.folder / f"{what}.pt"
        if trained.is_dir() and checkpoint.is_file():
            steps = int(torch.load(checkpoint, weights_only=True, mmap=True)["step"])
            publish(trained, held_out, args.to / what, date.today(), steps, pictures, _say)
        else:
            _say(f"no trained {what} in {args.folder}; train it first: python -m perception.train {what}")


@contextlib.contextmanager
def _rendering(folder: Path, shards: int) -> Iterator[None]:
    """A process that renders what is missing, ended when training ends."""
    command = [
        sys.executable,
        "-m",
        "sim_check.random_scenes.labelled_pictures",
        "--out",
        str(folder),
        "--shards",
        str(shards),
    ]
    process = subprocess.Popen(command, env={**os.environ, "LP_NUM_THREADS": "1"})
    try:
        yield
    finally:
        process.terminate()
        process.wait()


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
