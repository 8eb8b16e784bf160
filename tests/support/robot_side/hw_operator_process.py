"""An operator's program for tests: `python -m ...hw_operator_process ENDPOINT SECONDS LOOKS` looks, moves, looks.

It prints "moving" when its motion of the first joint over SECONDS is under way, and at the end one JSON object with
what became of it.
"""

import json
import sys

from benchmarks.robot_side.perfect_robot import certificate, from_here
from hw_interface.cell.client import CellClient, MotionProgress


def main(endpoint: str, seconds: float, looks: int) -> None:
    """Look so many times, move once, look as often again."""
    with CellClient.connect(endpoint) as client:
        pictures = sum(len(client.frames()) for _ in range(looks))
        motion = from_here(client, seconds, 0.2)
        told = False

        def tell(progress: MotionProgress) -> None:
            nonlocal told
            if not told and progress.played > 0:
                told = True
                print("moving", flush=True)

        report = client.execute(motion, certificate(motion), tell)
        pictures += sum(len(client.frames()) for _ in range(looks))
        print(json.dumps({"reason": report.reason, "played": report.played, "pictures": pictures}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]))
