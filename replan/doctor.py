"""What works on this machine: packages, rendering, model weights, a robot."""

import importlib.metadata
import importlib.util
import platform
from dataclasses import asdict, dataclass
from typing import Any

PACKAGES = {
    "mujoco": "twin and simulated cell",
    "pin": "robot dynamics",
    "toppra": "retiming",
    "eclipse-zenoh": "transport",
    "opencv-python-headless": "embedded detector and masks",
    "open3d": "point clouds",
    "torch": "learned models",
    "transformers": "GroundingDINO and SAM",
    "example-robot-data": "the Panda's description",
}
# Published models that the perception pipeline knows how to load, and what each is for.
MODELS = {
    "IDEA-Research/grounding-dino-base": "detector",
    "IDEA-Research/grounding-dino-tiny": "detector",
    "facebook/sam-vit-base": "segmenter",
    "facebook/sam2-hiera-tiny": "segmenter",
}


@dataclass(frozen=True)
class Finding:
    """One thing that was examined.

    Attributes:
        topic: "package", "rendering", "weights" or "robot".
        name: What was examined.
        ok: Whether it is there and works.
        detail: Version, place, or what to do.
        needed: Whether a simulated run is impossible without it.
    """

    topic: str
    name: str
    ok: bool
    detail: str
    needed: bool = False


@dataclass(frozen=True)
class Findings:
    """Everything that was examined."""

    items: tuple[Finding, ...]

    @property
    def can_simulate(self) -> bool:
        """Whether all that a simulated run needs is there."""
        return all(f.ok for f in self.items if f.needed)

    def as_json(self) -> dict[str, Any]:
        """As one JSON object."""
        return {
            "can_simulate": self.can_simulate,
            "platform": platform.platform(),
            "python": platform.python_version(),
            "findings": [asdict(f) for f in self.items],
        }


def examine(robot_endpoint: str) -> Findings:
    """Look at everything; takes a few seconds.

    Args:
        robot_endpoint: Where a robot process may be listening, for instance tcp/127.0.0.1:7447.
    """
    items = [_package(name, use) for name, use in PACKAGES.items()]
    items.append(_rendering())
    items.append(Finding("weights", "colour-and-shape detector", True, "embedded; not a learned model"))
    items.append(Finding("weights", "GrabCut-and-depth masks", True, "embedded; not a learned model"))
    items += [_weights(name, use) for name, use in MODELS.items()]
    items.append(_robot(robot_endpoint))
    return Findings(tuple(items))


def _package(name: str, use: str) -> Finding:
    needed = name not in ("torch", "transformers")
    try:
        return Finding("package", name, True, f"{importlib.metadata.version(name)} ({use})", needed)
    except importlib.metadata.PackageNotFoundError:
        return Finding("package", name, False, f"not installed ({use}); run: make setup", needed)


def _rendering() -> Finding:
    from control.errors import StackError
    from replan.rendering import require_mujoco

    try:
        require_mujoco()
        from sim_check.render import available_backend

        return Finding("rendering", "off-screen", True, f"MUJOCO_GL={available_backend()} works", needed=True)
    except StackError as error:
        return Finding("rendering", "off-screen", False, str(error), needed=True)


def _weights(name: str, use: str) -> Finding:
    if importlib.util.find_spec("huggingface_hub") is None:
        return Finding("weights", name, False, f"{use}; huggingface_hub is not installed; run: make setup")
    from huggingface_hub import try_to_load_from_cache

    path = try_to_load_from_cache(name, "config.json")
    weights = try_to_load_from_cache(name, "model.safetensors")
    if isinstance(path, str) and isinstance(weights, str):
        return Finding("weights", name, True, f"{use}, in the local cache")
    return Finding("weights", name, False, f"{use}, not here; fetch with: .venv/bin/hf download {name}")


def _robot(endpoint: str) -> Finding:
    from control.errors import StackError
    from hw_interface.client import CellClient

    try:
        with CellClient.connect(endpoint, timeout=1.0) as client:
            state = client.state()
    except StackError as error:
        return Finding("robot", endpoint, False, str(error))
    return Finding("robot", endpoint, True, f"{state.profile} in cell {state.cell}, mode {state.mode}")


def render(findings: Findings) -> str:
    """The findings as a table for people."""
    import io

    from rich.console import Console
    from rich.table import Table

    table = Table(title=None, box=None, pad_edge=False)
    for column in ("", "topic", "name", "detail"):
        table.add_column(column, overflow="fold")
    for f in findings.items:
        mark = "ok" if f.ok else ("MISSING" if f.needed else "-")
        table.add_row(mark, f.topic, f.name, f.detail)
    out = io.StringIO()
    Console(file=out, width=120, no_color=True).print(table)
    verdict = "a simulated run is possible" if findings.can_simulate else "a simulated run is NOT possible; see MISSING"
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + f"\n{verdict}"
