"""What a person at the terminal sees: progress on stderr, the result on stdout."""

import json as json_module
import sys
import time
from typing import Any


class Console:
    """Prints progress with the seconds since the start, and one result at the end.

    Args:
        json: Print the result as one JSON object instead of text.
        quiet: Print no progress.
    """

    def __init__(self, json: bool = False, quiet: bool = False) -> None:
        self.json = json
        self._quiet = quiet
        self._start = time.monotonic()

    def note(self, text: str) -> None:
        """One line of progress, to stderr."""
        if not self._quiet:
            print(f"[{time.monotonic() - self._start:6.1f} s] {text}", file=sys.stderr, flush=True)

    def fail(self, error: BaseException) -> None:
        """The one-line reason of an error; with `json` also as an object on stdout."""
        reason = " ".join(str(error).split()) or type(error).__name__
        print(f"replan: {reason}", file=sys.stderr, flush=True)
        if self.json:
            print(json_module.dumps({"error": type(error).__name__, "reason": reason}), flush=True)

    def result(self, data: dict[str, Any], text: str) -> None:
        """The result: `data` as JSON or `text` for people, to stdout."""
        print(json_module.dumps(data) if self.json else text, flush=True)
