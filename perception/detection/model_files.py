"""Where the weights of a learned model are, without loading them: a folder, or the hub client's store on this machine.

Reads only the small `config.json` beside the weights, so that wrong weights are named before anything heavy starts.
"""

import importlib.util
import json
from dataclasses import dataclass
from pathlib import Path

from perception.errors import ModelUnavailableError
from replan_base.parts import install_part

# One of these holds the weights: a single file, or the list of several.
WEIGHT_FILES = ("model.safetensors", "model.safetensors.index.json")
FETCHED = ("*.json", "*.txt", "*.jinja", "*.model", "*.safetensors")


@dataclass(frozen=True)
class Role:
    """What a model is used for, and which architectures can do it.

    Attributes:
        name: "detector" or "segmenter", also the name of the option that chooses it.
        needed: The architectures in words.
        model_types: The same as `model_type` of a config.json; empty when the name alone does not tell.
        example: A hub name that fits.
    """

    name: str
    needed: str
    model_types: tuple[str, ...]
    example: str


DETECTOR = Role(
    "detector",
    "GroundingDINO or MM-GroundingDINO",
    ("grounding-dino", "mm-grounding-dino"),
    "IDEA-Research/grounding-dino-tiny",
)
# The published SAM 2 folders say "sam2_video": they hold the video model, whose picture part is the one used here.
SEGMENTER = Role("segmenter", "SAM or SAM 2", ("sam", "sam2", "sam2_video"), "facebook/sam-vit-base")


def find_model(model: str, role: Role, offline: bool) -> Path:
    """The folder that holds a model's files; what is on this machine already is used without asking the hub.

    Args:
        model: A folder, or a hub name (owner/model).
        role: What the model must be able to do.
        offline: Never ask the hub; otherwise a hub model that is not here is fetched.

    Raises:
        ModelUnavailableError: There is no such folder or model, it is incomplete or of another architecture.
    """
    folder = Path(model).expanduser()
    if folder.is_dir():
        check_architecture(folder, model, role)
        return folder
    if model.startswith((".", "/", "~")) or model.count("/") != 1:
        raise ModelUnavailableError(
            f"there is no folder '{model}' and it is no hub name (owner/model); "
            f"give a folder that holds config.json and weights, or a name such as {role.example}"
        )
    found = cached_folder(model)
    if found is None:
        if offline:
            raise ModelUnavailableError(
                f"the weights of '{model}' ({role.needed}) are not on this machine; "
                f"fetch them once with: {fetch_command(model)}"
            )
        found = _fetch(model, role)
    check_architecture(found, model, role)
    return found


def check_architecture(folder: Path, model: str, role: Role) -> None:
    """Refuse a folder without weights or with those of another architecture.

    Raises:
        ModelUnavailableError: Says what was found and what is needed.
    """
    try:
        kind = json.loads((folder / "config.json").read_text())["model_type"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        reason = "it has no config.json" if isinstance(error, OSError) else "its config.json names no model_type"
        raise ModelUnavailableError(
            f"'{model}' does not hold a {role.name}: {reason}; a {role.name} must be {role.needed}, "
            f"saved by transformers, such as {role.example}"
        ) from error
    if role.model_types and kind not in role.model_types:
        other = next((r for r in (DETECTOR, SEGMENTER) if kind in r.model_types), None)
        hint = f"pass it as --{other.name}" if other else f"choose another model, such as {role.example}"
        raise ModelUnavailableError(
            f"'{model}' holds a '{kind}' model, but a {role.name} must be {role.needed}; {hint}"
        )
    if not any((folder / name).is_file() for name in WEIGHT_FILES):
        raise ModelUnavailableError(
            f"'{model}' has a config.json but no weights; it needs {' or '.join(WEIGHT_FILES)} beside it"
        )


def cached_folder(model: str) -> Path | None:
    """Where the hub's client keeps a model on this machine; None if it is not here or incomplete.

    The client's own environment variables (HF_HOME, HF_HUB_CACHE) say where it looks.
    """
    if importlib.util.find_spec("huggingface_hub") is None:
        return None
    from huggingface_hub import try_to_load_from_cache

    config = try_to_load_from_cache(model, "config.json")
    if not isinstance(config, str) or not any(
        isinstance(try_to_load_from_cache(model, name), str) for name in WEIGHT_FILES
    ):
        return None
    return Path(config).parent


def fetch_command(model: str) -> str:
    """What a person types to get a hub model."""
    return f".venv/bin/hf download {model}"


def size_on_disk(folder: Path) -> int:
    """Size of the files that would be loaded, in bytes."""
    return sum(f.stat().st_size for pattern in FETCHED for f in folder.glob(pattern))


def _fetch(model: str, role: Role) -> Path:
    if importlib.util.find_spec("huggingface_hub") is None:
        raise ModelUnavailableError(
            "models from the hub need the package 'huggingface_hub', which is not installed; install it with: "
            + install_part("perception")
        )
    from huggingface_hub import snapshot_download
    from huggingface_hub.errors import RepositoryNotFoundError

    try:
        return Path(snapshot_download(model, allow_patterns=list(FETCHED)))
    except RepositoryNotFoundError as error:
        raise ModelUnavailableError(
            f"the hub has no model '{model}' that may be read without an account; "
            f"check the name, for instance {role.example}, or give a folder"
        ) from error
    except Exception as error:  # the client's HTTP library has errors of its own, with no common root
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise ModelUnavailableError(
            f"the weights of '{model}' ({role.needed}) are not on this machine and cannot be fetched now ({reason}); "
            f"where there is a network, fetch them once with: {fetch_command(model)}"
        ) from error
