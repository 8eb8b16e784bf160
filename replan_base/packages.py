"""Whether this program's top-level packages are its own: others on the index have names like `control` as well.

Installers write into what is there: with python-control in the same environment, one `control` package holds the files
of both, and the `__init__.py` of whichever came last. No installer tells; so the command looks before it imports more.
"""

import importlib.util
import os
from collections.abc import Iterator
from pathlib import Path

from replan_base.errors import ForeignPackageError

PACKAGES = (
    "benchmarks",
    "control",
    "hw_interface",
    "perception",
    "planning",
    "prompts",
    "replan",
    "replan_base",
    "sim_check",
)
ROOT = Path(__file__).resolve().parents[1]
REMEDY = (
    "install this program in an environment of its own, for instance with 'uv tool install' or 'pipx install' "
    "(docs/install.md)"
)


def require_own_packages(root: Path = ROOT) -> None:
    """Find every top-level package of ours where this program lies, as it was installed and with nothing else in it.

    Reads one list of files and nine folders, a few milliseconds. Where nothing was installed but a checkout is used,
    there is no list, and only the places count.

    Args:
        root: The folder that holds the packages.

    Raises:
        ForeignPackageError: Names the package, whose files were found, and what to do.
    """
    for name in PACKAGES:
        spec = importlib.util.find_spec(name)
        if spec is None or spec.origin is None:
            raise ForeignPackageError(f"the package '{name}' of this program is incomplete ({root / name}); {REMEDY}")
        found = Path(spec.origin).resolve()
        if found != root / name / "__init__.py":
            owner = _owner(found.parents[1] if found.name == "__init__.py" else found.parent, name)
            raise ForeignPackageError(
                f"the package '{name}' that Python finds is {found}, {owner}, and hides this program's in {root}; "
                f"{REMEDY}"
            )
    installed = _installed_files(root)
    for name in PACKAGES if installed else ():
        ours = installed.get(name, {})
        there = {entry.name for entry in os.scandir(root / name) if not entry.name.startswith(".")} - {"__pycache__"}
        strange = sorted(there - ours.keys())
        if strange or (root / name / "__init__.py").stat().st_size != ours["__init__.py"]:
            owner, example = _owner(root, name), f"{name}/{strange[0] if strange else '__init__.py'}"
            raise ForeignPackageError(
                f"the package '{name}' of this environment is mixed with another one of that name: {example} is not of "
                f"this program, but {owner}, and neither can be relied on; {REMEDY}, and install the other one anew"
            )


def _installed_files(root: Path) -> dict[str, dict[str, int]]:
    """What was installed directly in each package: sizes in bytes by name, 0 for folders; empty for a checkout."""
    installed: dict[str, dict[str, int]] = {}
    for record in root.glob("replan-*.dist-info/RECORD"):
        for line in record.read_text(encoding="utf-8").splitlines():
            path, _, rest = line.partition(",")
            package, _, inside = path.partition("/")
            if package in PACKAGES and inside:
                first, *deeper = inside.split("/")
                installed.setdefault(package, {})[first] = 0 if deeper else int(rest.rpartition(",")[2] or 0)
    return installed


def _owner(folder: Path, package: str) -> str:
    """In words, which other installed distribution has files in a package."""
    owners = sorted(name for name in _distributions_with(folder, package) if name.partition(" ")[0] != "replan")
    return f"of {', '.join(owners)}" if owners else "of no distribution that is known here"


def _distributions_with(folder: Path, package: str) -> Iterator[str]:
    """Names and versions of the distributions in a folder that say that they have files in a package."""
    for record in folder.glob("*.dist-info/RECORD"):
        if f"\n{package}/" in "\n" + record.read_text(encoding="utf-8", errors="replace"):
            name, _, version = record.parent.name.removesuffix(".dist-info").partition("-")
            yield f"{name} {version}"
