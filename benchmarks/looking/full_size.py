"""What full-size models cost on this machine's processor: built from their configurations with random weights.

Nothing is fetched. Boxes and masks of random weights mean nothing; time and memory do not depend on the weights.
Each model is saved to a temporary folder and read back by a process of its own, through the same classes that read
published weights, so that its peak memory is its own.

    python -m benchmarks.looking.full_size
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from perception.detection.devices import load_package
from perception.detection.hf_detector import TransformersDetector
from perception.detection.hf_segmenter import TransformersSegmenter
from perception.frames import CameraIntrinsics, RgbdFrame
from replan_base.processes import python_module

WIDTH, HEIGHT = 640, 480  # [px] of the frame; each model scales it to its own size
PHRASES = ("red cube", "wooden crate", "blue bowl", "yellow lemon")
BOXES = np.array([[100.0, 100.0, 200.0, 220.0], [300.0, 80.0, 420.0, 180.0], [50.0, 300.0, 150.0, 400.0]])
FRAMES = 2  # measured, after one that warms up
# transformers' GroundingDINO cuts prompts at these numbers of its published vocabulary.
FIXED_WORDS = {"[PAD]": 0, "[UNK]": 100, "[CLS]": 101, "[SEP]": 102, "[MASK]": 103, ".": 1012, "?": 1029}
VOCABULARY = 30522  # words of the published text encoder


def save_grounding_dino(folder: Path, backbone: dict[str, Any]) -> None:
    """A GroundingDINO with random weights; all but the backbone is as published for both sizes."""
    from transformers import (
        BertTokenizer,
        GroundingDinoConfig,
        GroundingDinoForObjectDetection,
        GroundingDinoImageProcessor,
        GroundingDinoProcessor,
        SwinConfig,
    )

    swin = SwinConfig(**backbone, out_indices=[2, 3, 4])  # type: ignore[call-arg]
    GroundingDinoForObjectDetection(GroundingDinoConfig(backbone_config=swin)).save_pretrained(folder)
    words = dict(FIXED_WORDS)
    letters = [f"{mark}{chr(c)}" for mark in ("", "##") for c in range(ord("a"), ord("z") + 1)]
    free = (i for i in range(VOCABULARY) if i not in FIXED_WORDS.values())
    words |= {word: next(free) for word in (*dict.fromkeys(" ".join(PHRASES).split()), *letters)}
    words |= {f"[unused{i}]": i for i in free}
    tokenizer = BertTokenizer(vocab=words, do_lower_case=True)
    GroundingDinoProcessor(GroundingDinoImageProcessor(), tokenizer).save_pretrained(folder)


def save_sam(folder: Path) -> None:
    """A SAM with the ViT-B backbone, which its configuration has by default."""
    from transformers import SamConfig, SamImageProcessor, SamModel, SamProcessor

    SamModel(SamConfig()).save_pretrained(folder)
    SamProcessor(SamImageProcessor()).save_pretrained(folder)


def save_sam2(folder: Path) -> None:
    """A SAM 2 with the Hiera-T backbone, which its configuration has by default."""
    from transformers import Sam2Config, Sam2Model

    Sam2Model(Sam2Config()).save_pretrained(folder)


SWIN_TINY = {"embed_dim": 96, "depths": [2, 2, 6, 2], "num_heads": [3, 6, 12, 24], "window_size": 7}
SWIN_BASE = {
    "embed_dim": 128,
    "depths": [2, 2, 18, 2],
    "num_heads": [4, 8, 16, 32],
    "window_size": 12,
    "image_size": 384,
}
MODELS: dict[str, tuple[str, Callable[[Path], None]]] = {
    "grounding-dino-tiny": ("detector", lambda folder: save_grounding_dino(folder, SWIN_TINY)),
    "grounding-dino-base": ("detector", lambda folder: save_grounding_dino(folder, SWIN_BASE)),
    "sam-vit-base": ("segmenter", save_sam),
    "sam2-hiera-tiny": ("segmenter", save_sam2),
}


def noise_frame(seed: int) -> RgbdFrame:
    """A picture of noise; each seed gives another, so that nothing remembered of one helps with the next."""
    colour = np.random.default_rng(seed).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    lens = CameraIntrinsics(WIDTH, HEIGHT, 600.0, 600.0, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)
    return RgbdFrame(colour, np.full((HEIGHT, WIDTH), 0.8, np.float32), lens, np.eye(4), 0.0)


def measure(name: str, folder: Path) -> dict[str, float]:
    """Cost of a saved model in this process.

    Returns:
        parameters_m (millions), load_s, cpu_s and wall_s a frame, peak_mb of the process, threads.
    """
    torch = load_package("torch")
    started = time.perf_counter()
    if MODELS[name][0] == "detector":
        detector = TransformersDetector(str(folder), offline=True, device="cpu")

        def look(frame: RgbdFrame) -> None:
            detector.detect(frame, PHRASES)
    else:
        segmenter = TransformersSegmenter(str(folder), offline=True, device="cpu")

        def look(frame: RgbdFrame) -> None:
            segmenter.segment_all(frame, BOXES)

    look(noise_frame(0))
    loaded = time.perf_counter() - started
    cpu, wall = time.process_time(), time.perf_counter()
    for k in range(FRAMES):
        look(noise_frame(k + 1))
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    return {
        "parameters_m": round(_parameters(folder) / 1e6, 1),
        "load_and_first_frame_s": round(loaded, 1),
        "cpu_s": round(cpu / FRAMES, 2),
        "wall_s": round(wall / FRAMES, 2),
        "peak_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
        "threads": torch.get_num_threads(),
    }


def _parameters(folder: Path) -> int:
    """Numbers in the files of weights."""
    from safetensors import safe_open

    count = 0
    for file in folder.glob("*.safetensors"):
        with safe_open(str(file), "np") as weights:
            count += sum(int(np.prod(weights.get_slice(key).get_shape())) for key in weights.keys())  # noqa: SIM118
    return count


def costs(names: tuple[str, ...] = tuple(MODELS)) -> dict[str, dict[str, float]]:
    """Cost of each model, each built and measured in processes of their own."""
    report = {}
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            for step in ("--save", "--measure"):
                print(f"{name}: {step[2:]}", file=sys.stderr, flush=True)
                command = python_module("benchmarks.looking.full_size", step, name, "--folder", folder)
                done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
            report[name] = json.loads(done.stdout.splitlines()[-1])
    return report


def costs_table(report: dict[str, dict[str, float]]) -> str:
    """The same as text."""
    head = ("model", "parameters", "first frame s", "CPU s a frame", "wall s", "peak MB", "threads")
    lines = ["{:22}{:>12}{:>15}{:>15}{:>9}{:>10}{:>9}".format(*head)]
    for name, row in report.items():
        size = f"{row['parameters_m']:.0f} M"
        lines.append(
            f"{name:22}{size:>12}{row['load_and_first_frame_s']:>15}{row['cpu_s']:>15}{row['wall_s']:>9}"
            f"{row['peak_mb']:>10.0f}{row['threads']:>9}"
        )
    lines.append(f"frames of {WIDTH} x {HEIGHT}; {len(PHRASES)} phrases, {len(BOXES)} boxes; random weights")
    return "\n".join(lines)


def main() -> int:
    """Measure all models, or do one step for one of them; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--models", nargs="+", default=list(MODELS), choices=list(MODELS))
    parser.add_argument("--save", choices=list(MODELS), help=argparse.SUPPRESS)
    parser.add_argument("--measure", choices=list(MODELS), help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    args = parser.parse_args()
    if args.save:
        load_package("torch")
        MODELS[args.save][1](args.folder)
    elif args.measure:
        print(json.dumps(measure(args.measure, args.folder)))
    else:
        report = costs(tuple(args.models))
        print(json.dumps(report) if args.json else costs_table(report))
    return 0


if __name__ == "__main__":
    sys.exit(main())
