"""Recording a cell's cameras into an MCAP file that ROS 2's tools and `replan perceive` read."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from control.errors import ConfigError
from replan.errors import DONE
from replan.robot.options import RecordOptions
from replan_base.interruption import held_back
from replan_base.processes import python_module

if TYPE_CHECKING:
    from hw_interface.cell.client import CellClient

FREE_PORT = "tcp/127.0.0.1:0"  # the process picks one and says which
PROGRESS_PERIOD = 2.0  # [s] between two lines of progress


@dataclass(frozen=True)
class RecordReport:
    """What was recorded.

    Attributes:
        path: The file.
        frames: Frames of each camera.
        seconds: From the first to the last in [s].
        size: Of the file in [bytes].
        has_truth: Whether the file says what truly was in its frames.
        interrupted: Whether Ctrl-C ended it.
        exit_code: Of the command.
    """

    path: Path
    frames: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0
    size: int = 0
    has_truth: bool = False
    interrupted: bool = False
    exit_code: int = DONE

    def as_json(self) -> dict[str, Any]:
        """As one JSON object."""
        return {
            "path": str(self.path),
            "frames": self.frames,
            "seconds": round(self.seconds, 3),
            "bytes": self.size,
            "has_truth": self.has_truth,
            "interrupted": self.interrupted,
        }

    def as_text(self) -> str:
        """For people."""
        each = ", ".join(f"{count} of camera '{name}'" for name, count in self.frames.items())
        most = max(self.frames.values(), default=0)
        rate = f" ({(most - 1) / self.seconds:.1f} a second)" if self.seconds > 0 else ""
        truth = ", with what truly was in them" if self.has_truth else ""
        return f"recorded {each} in {self.seconds:.1f} s{rate}{truth}\n  {self.path}: {self.size / 1e6:.1f} MB"


def record(options: RecordOptions, say: Callable[[str], None]) -> RecordReport:
    """Record frames until enough are there or Ctrl-C; the file is complete however this ends.

    Args:
        options: What to record, from where.
        say: Progress for people, one line a call.

    Raises:
        ConfigError: An option that is not valid, or a file that exists or cannot be written.
        RobotGoneError: Nobody answers at the endpoint, or no longer; what was recorded until then stays.
    """
    _check(options)
    from hw_interface.cell.client import CellClient
    from hw_interface.link.security import link_of
    from sim_check.cells.loading import load_cell

    security = link_of(options.robot, options.link)

    with ExitStack() as stack:
        endpoint = options.robot or _start_cell(options, say, stack)
        client = stack.enter_context(CellClient.connect(endpoint, security=security))
        cameras = options.cameras or client.cameras()
        missing = [c for c in cameras if c not in client.cameras()]
        if missing:
            raise ConfigError(f"the cell has no camera '{missing[0]}'; it has {', '.join(client.cameras())}")
        if options.truth and not client.info.scored:
            raise ConfigError(
                "the cell does not say what truly is there: only a simulated cell that was started with --score does; "
                "leave out --truth"
            )
        # Which cameras stand still is in the cell file; of a cell that is not the named one nothing is assumed.
        cell = load_cell(options.cell, dict.fromkeys(options.cell_options, True))
        fixed = {c.name for c in cell.cameras if c.mounting == "static"} if client.info.cell == cell.name else set()
        return _record(client, cameras, fixed, options, say)


def _check(options: RecordOptions) -> None:
    if not options.rate > 0.0:
        raise ConfigError(f"--rate {options.rate:g} is not valid; it is frames a second, for instance 5")
    if options.seconds is not None and not options.seconds > 0.0:
        raise ConfigError(f"--seconds {options.seconds:g} is not valid; it must be above 0")
    if options.frames is not None and options.frames < 1:
        raise ConfigError(f"--frames {options.frames} is not valid; it must be 1 or more")
    if options.compress and options.depth != "16UC1":
        raise ConfigError("--compress keeps depth as 16-bit PNG; leave out --depth 32FC1 or --compress")
    if options.out.suffix.lower() != ".mcap":
        raise ConfigError(f"'{options.out}' is no name of an MCAP file; it must end in .mcap")
    if options.out.exists():
        raise ConfigError(f"'{options.out}' exists; name another file, or remove it")


def _record(
    client: "CellClient", cameras: tuple[str, ...], fixed: set[str], options: RecordOptions, say: Callable[[str], None]
) -> RecordReport:
    from perception.recordings.mcap_writing import McapFrameWriter

    counts = dict.fromkeys(cameras, 0)
    first = last = None
    try:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        writer = McapFrameWriter(options.out, options.depth, options.compress, fixed)
    except OSError as error:
        raise ConfigError(f"cannot write '{options.out}': {error.strerror}; name another file") from error
    ends = [f"{options.frames} frames"] if options.frames is not None else []
    ends += [f"{options.seconds:g} s"] if options.seconds is not None else []
    say(f"recording {', '.join(cameras)} into {options.out}: {' or '.join(ends) or 'no end'}; Ctrl-C ends it")
    # Ctrl-C raises nothing here: a half written message would spoil the file.
    with held_back() as asked, writer:
        began = time.monotonic()
        due, told = began, began
        while not asked():
            now = time.monotonic()
            if options.frames is not None and min(counts.values()) >= options.frames:
                break
            if options.seconds is not None and now - began >= options.seconds:
                break
            if now < due:
                time.sleep(min(due - now, 0.05))
                continue
            due = max(due + 1.0 / options.rate, now)  # a cell that is slower is recorded as fast as it goes
            for camera in cameras:
                (frame,) = client.frames([camera])
                writer.write(frame, client.frame_truth(camera) if options.truth else None)
                counts[camera] += 1
                first, last = first if first is not None else frame.stamp, frame.stamp
            if now - told >= PROGRESS_PERIOD:
                told = now
                say(f"{max(counts.values())} frames a camera, {now - began:.0f} s")
        interrupted = asked()
    seconds = 0.0 if first is None or last is None else last - first
    size = options.out.stat().st_size
    return RecordReport(options.out, counts, seconds, size, options.truth, interrupted)


def _start_cell(options: RecordOptions, say: Callable[[str], None], stack: ExitStack) -> str:
    """Start a simulated cell, which ends with the stack; its endpoint."""
    from hw_interface.cell.process import start_sim_process

    say("no robot named: starting a simulated cell (nothing real moves)")
    command = python_module("replan.main", "robot", "sim", "--cell", options.cell, "--endpoint", FREE_PORT)
    command += ["--seed", str(options.seed)]
    for name in options.cell_options:
        command += ["--option", name]
    if options.truth:
        command.append("--score")
    return stack.enter_context(start_sim_process(command)).endpoint
