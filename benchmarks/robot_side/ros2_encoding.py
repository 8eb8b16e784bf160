"""What encoding messages of ROS 2 costs: by the library rosbags, and by hand with `struct`, as version 0.1.0 did.

Both write the same bytes, which is checked first, and take turns message by message. A message that is let go at once
finds its memory warm; one that is kept, as in a queue, gets memory that the operating system hands out page by page.
"Start" is what the first message waits for in a fresh interpreter with NumPy: the library's types, then the encoders.

    python -m benchmarks.robot_side.ros2_encoding [--repeats 40] [--starts 5] [--json]
"""

import argparse
import json
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from hw_interface.ros2.encoding import joint_state, joint_trajectory
from perception.ros2.messages import image

WIDTH, HEIGHT = 1280, 720
STAMP = 1_700_000_000_250_000_001  # [ns]
JOINTS = tuple(f"panda_joint{k}" for k in range(1, 8))
START = """
import time
from benchmarks.robot_side.ros2_encoding import cases
from perception.ros2.messages import message_types
all_cases = cases()
begun = time.perf_counter()
message_types()
built = time.perf_counter()
for case in all_cases:
    case.library()
print(built - begun, time.perf_counter() - built)
"""


class HandWritten:
    """Bytes of one message, field after field; numbers are aligned to their own size behind the header."""

    def __init__(self) -> None:
        self._bytes = bytearray([0, 1, 0, 0])

    def put(self, form: str, *values: float) -> "HandWritten":
        """Numbers, each by a character of `struct`."""
        for code, value in zip(form, values, strict=True):
            self._align(struct.calcsize(code))
            self._bytes += struct.pack("<" + code, value)
        return self

    def text(self, text: str) -> "HandWritten":
        """A string."""
        data = text.encode() + b"\0"
        self.put("I", len(data))
        self._bytes += data
        return self

    def header(self, frame: str) -> "HandWritten":
        """A std_msgs/Header."""
        return self.put("iI", *divmod(STAMP, 10**9)).text(frame)

    def texts(self, texts: Sequence[str]) -> "HandWritten":
        """A string[]."""
        self.put("I", len(texts))
        for text in texts:
            self.text(text)
        return self

    def numbers(self, values: np.ndarray) -> "HandWritten":
        """A float64[], shape (n,)."""
        self.put("I", len(values))
        if len(values):
            self._align(8)
            self._bytes += np.asarray(values, "<f8").tobytes()
        return self

    def blob(self, data: bytes) -> "HandWritten":
        """A uint8[]."""
        self.put("I", len(data))
        self._bytes += data
        return self

    @property
    def data(self) -> bytes:
        """The whole message."""
        return bytes(self._bytes)

    def _align(self, size: int) -> None:
        self._bytes += bytes(-(len(self._bytes) - 4) % size)


@dataclass(frozen=True)
class Case:
    """A message and its two encoders."""

    name: str
    library: Callable[[], bytes | memoryview]
    by_hand: Callable[[], bytes]


@dataclass(frozen=True)
class Row:
    """What one encoder takes for one message, in [ms].

    Attributes:
        message, size: What was encoded, and its bytes.
        memory: "warm" or "new".
        encoder: "rosbags" or "by hand".
    """

    message: str
    size: int
    memory: str
    encoder: str
    p10: float
    p50: float
    p90: float


@dataclass(frozen=True)
class Report:
    """All figures.

    Attributes:
        rows: Encoding, message by message.
        types, first: Of each fresh interpreter in [ms]: building the types, and writing every message here once.
    """

    rows: tuple[Row, ...]
    types: tuple[float, ...]
    first: tuple[float, ...]


def cases() -> list[Case]:
    """The messages that are measured: two pictures of 720p, joints of a state, the points of a motion of 5 s."""
    draw = np.random.default_rng(0)
    colour = draw.integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    depth = draw.random((HEIGHT, WIDTH)).astype(np.float32)
    q, times = draw.normal(size=(500, 7)), np.arange(500) * 10_000_000

    def picture(encoding: str, pixels: np.ndarray) -> bytes:
        data = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<")).tobytes()
        head = HandWritten().header("camera").put("II", HEIGHT, WIDTH).text(encoding)
        return head.put("BI", 0, len(data) // HEIGHT).blob(data).data

    def joints() -> bytes:
        return HandWritten().header("base").texts(JOINTS).numbers(q[0]).numbers(q[1]).numbers(q[2]).data

    def motion() -> bytes:
        out, nothing = HandWritten().header("base").texts(JOINTS).put("I", len(q)), np.empty(0)
        for at, row in zip(times, q, strict=True):
            out.numbers(row).numbers(row).numbers(row).numbers(nothing).put("iI", *divmod(int(at), 10**9))
        return out.data

    return [
        Case("picture 720p rgb8", lambda: image(STAMP, "camera", "rgb8", colour), lambda: picture("rgb8", colour)),
        Case("picture 720p 32FC1", lambda: image(STAMP, "camera", "32FC1", depth), lambda: picture("32FC1", depth)),
        Case("joints of a state", lambda: joint_state(STAMP, "base", JOINTS, q[0], q[1], q[2]), joints),
        Case("motion of 500 points", lambda: joint_trajectory(STAMP, "base", JOINTS, times, q, q, q), motion),
    ]


def measure(repeats: int, starts: int) -> Report:
    """Measure everything.

    Args:
        repeats: How often each message is encoded.
        starts: Fresh interpreters.

    Raises:
        ValueError: The two encoders do not write the same bytes.
    """
    rows = []
    for case in cases():
        if case.library() != case.by_hand():
            raise ValueError(f"the two encoders write different bytes for '{case.name}'")
        encoders = {"rosbags": case.library, "by hand": case.by_hand}
        for memory in ("warm", "new"):
            took: dict[str, list[float]] = {name: [] for name in encoders}
            kept = []
            for _ in range(repeats):
                for name, encode in encoders.items():
                    begun = time.perf_counter()
                    message = encode()
                    took[name].append(1e3 * (time.perf_counter() - begun))
                    if memory == "new":
                        kept.append(message)
                    del message
            size = len(case.by_hand())
            rows += [Row(case.name, size, memory, n, *np.percentile(t, [10, 50, 90]).tolist()) for n, t in took.items()]
    command = [sys.executable, "-c", START]
    begun = [subprocess.run(command, capture_output=True, text=True, check=True).stdout.split() for _ in range(starts)]
    types, first = zip(*((1e3 * float(a), 1e3 * float(b)) for a, b in begun), strict=True) if begun else ((), ())
    return Report(tuple(rows), types, first)


def as_text(report: Report) -> str:
    """A table for people."""
    lines = [f"{'message':22}{'bytes':>9}  {'memory':8}{'encoder':9}{'p10':>9}{'p50':>9}{'p90':>9}  [ms]"]
    lines += [
        f"{r.message:22}{r.size:9}  {r.memory:8}{r.encoder:9}{r.p10:9.3f}{r.p50:9.3f}{r.p90:9.3f}" for r in report.rows
    ]
    for what, values in (("start: the types", report.types), ("start: every message once", report.first)):
        if values:
            lines.append(f"{what}: {', '.join(f'{v:.0f}' for v in values)} ms")
    return "\n".join(lines)


def main() -> None:
    """Print the table, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=40, help="how often each message is encoded")
    parser.add_argument("--starts", type=int, default=5, help="fresh interpreters; 0 for none")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    report = measure(options.repeats, options.starts)
    print(json.dumps(asdict(report)) if options.json else as_text(report))


if __name__ == "__main__":
    main()
