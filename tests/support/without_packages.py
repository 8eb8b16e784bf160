"""`-m tests.support.without_packages PACKAGE,... MODULE [ARGUMENT ...]`: a module run where packages are missing.

It behaves as if they were not installed: importing one raises ModuleNotFoundError and their versions are unknown.
"""

import importlib.abc
import importlib.metadata
import runpy
import sys


class Missing(importlib.abc.MetaPathFinder):
    """Finds the named packages missing."""

    def __init__(self, names: list[str]) -> None:
        self._names = names

    def find_spec(self, fullname, path=None, target=None):
        """Raise for the named packages; leave everything else to the others."""
        if fullname.partition(".")[0] in self._names:
            raise ModuleNotFoundError(f"No module named '{fullname}'", name=fullname)
        return None


def hide(missing: list[str]) -> None:
    """Behave from now on as if these packages were not installed."""
    sys.meta_path.insert(0, Missing(missing))
    known = importlib.metadata.version

    def version(name: str) -> str:
        if name in missing:
            raise importlib.metadata.PackageNotFoundError(name)
        return known(name)

    importlib.metadata.version = version


def main() -> None:
    """Hide the packages, then run the module as `python -m` does."""
    hide(sys.argv[1].split(","))
    sys.argv = sys.argv[2:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
