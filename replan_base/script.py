"""`-m replan_base.script MODULE [ARGUMENT ...]`: a module run as by `python -m`, missing packages told in one line."""

import runpy
import sys

from replan_base.errors import MissingPartError
from replan_base.parts import missing_parts_named


def main() -> None:
    """Run the module."""
    del sys.argv[0]
    try:
        with missing_parts_named():
            runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
    except MissingPartError as error:
        sys.exit(f"replan: {error}")


if __name__ == "__main__":
    main()
