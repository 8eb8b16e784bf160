"""Networks and processors of `transformers` out of a folder, whole or not at all.

Weights come from a local folder or, by name, from what the hub's client has downloaded to this machine or may download
(`perception.detection.model_files`).
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from perception.detection.devices import load_package
from perception.detection.model_files import Role
from perception.errors import ModelUnavailableError


def complete_network(kind: Any, folder: Path) -> Any:
    """The network of a folder; transformers would only warn of absent weights, and fill them at random."""
    network, report = kind.from_pretrained(
        folder, local_files_only=True, use_safetensors=True, output_loading_info=True
    )
    missing = sorted(report["missing_keys"])
    if missing:
        raise ValueError(f"{len(missing)} of its weights are absent, the first is {missing[0]}")
    return network


def loaded(folder: Path, role: Role, load: Callable[[], tuple[Any, Any]], device: str) -> tuple[Any, Any]:
    """Load processor and network, for use only; weights saved in half precision are widened.

    Raises:
        ModelUnavailableError: With what is wrong with the files.
    """
    torch = load_package("torch")
    load_package("transformers").utils.logging.disable_progress_bar()
    try:
        processor, network = load()
    except ImportError as error:
        reason = str(error).strip().splitlines()[0]
        raise ModelUnavailableError(f"'{folder}' needs a package that is not installed: {reason}") from error
    except (OSError, ValueError, KeyError, RuntimeError, AttributeError, TypeError) as error:
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise ModelUnavailableError(
            f"the folder '{folder}' does not hold a {role.name} ({role.needed}) that transformers can load: {reason}"
        ) from error
    return processor, network.to(device=device, dtype=torch.float32).eval()
