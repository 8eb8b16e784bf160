"""On which device and with which precision learned models run, and the packages that they need."""

import contextlib
import importlib
import sys
from typing import Any, Literal

from perception.errors import ModelUnavailableError
from replan_base.parts import install_part

Precision = Literal["auto", "half", "single"]


def choose_device(device: str) -> str:
    """The device to run on, as torch names it: "cpu" or "cuda:0".

    Args:
        device: "auto" (CUDA if there is any), "cpu", "cuda" or "cuda:1".

    Raises:
        ModelUnavailableError: CUDA was asked for and is not there, or torch is not installed.
    """
    torch = load_package("torch")
    there = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if device == "auto":
        return "cuda:0" if there else "cpu"
    if device == "cpu":
        return device
    number = int(device.partition(":")[2] or 0)
    if number >= there:
        have = f"torch sees {there} of them (cuda:0 to cuda:{there - 1})" if there else "torch sees none"
        raise ModelUnavailableError(
            f"device '{device}' was asked for, but of CUDA devices {have}; use --device cpu or --device auto"
        )
    return f"cuda:{number}"


def arithmetic(device: str, precision: Precision) -> contextlib.AbstractContextManager:
    """Within this context networks compute with the precision.

    Half precision means that matrix products run in 16 bits (float16 on CUDA, bfloat16 on a CPU) while weights and
    coordinates stay in 32: GroundingDINO refines boxes in shares of the picture, and bfloat16 alone would round them
    to 1/256.

    Args:
        device: As `choose_device` gives it.
        precision: "auto" is half on CUDA and single on a CPU.
    """
    torch = load_package("torch")
    on_cpu = device == "cpu"
    if precision == "single" or (precision == "auto" and on_cpu):
        return contextlib.nullcontext()
    return torch.autocast("cpu" if on_cpu else "cuda", dtype=torch.bfloat16 if on_cpu else torch.float16)


def load_package(name: str) -> Any:
    """Import torch or transformers, without triton.

    Triton carries an LLVM of its own that crashes the process when OpenGL in software (Mesa, which carries another) was
    loaded before it, as it is where MuJoCo renders without a GPU. Running a model eagerly does not need triton.

    Raises:
        ModelUnavailableError: The package is not installed.
    """
    sys.modules.setdefault("triton", None)  # type: ignore[arg-type]
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ModelUnavailableError(
            f"learned detectors and segmenters need the package '{name}', which is not installed; install it with: "
            + install_part("perception")
        ) from error
