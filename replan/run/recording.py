"""The record of a run: its folder and event log, its film, what was asked of reasoners, and an MCAP file if wanted."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from replan.run.episode import Episode
from replan.run.film import Film
from replan_base.interruption import held_back

if TYPE_CHECKING:
    from hw_interface.cell.client import CellClient
    from hw_interface.link.security import LinkSecurity
    from planning.reasoners.usage import UsageLog
    from replan.run.options import RecordingOptions
    from sim_check.cells.loading import CellConfig


def begin_record(
    options: "RecordingOptions", label: str, say: Callable[[str], None], stack: ExitStack
) -> tuple[Episode, Film]:
    """A new folder for a run, and its film; both are complete when `stack` ends.

    Args:
        options: Where, and what to keep.
        label: Becomes part of the folder's name.
        say: Progress for people.
        stack: Ends with the run.

    Raises:
        ConfigError: The folder cannot be made or written to.
    """
    episode, film = Episode.create(options.runs_dir, label), Film()
    stack.callback(episode.close)
    stack.callback(_write_film, film, episode, options, say)
    return episode, film


@contextmanager
def usage_recorded(episode: Episode, usage: "UsageLog") -> Iterator[None]:
    """Log at the end what was asked of reasoners, and why the run ended early if an error ended it."""
    try:
        yield
    except BaseException as error:
        episode.log("reasoner_usage", by_contract=usage.as_rows(), total=usage.total())
        episode.log("ended_early", error=type(error).__name__, reason=str(error))
        raise
    episode.log("reasoner_usage", by_contract=usage.as_rows(), total=usage.total())


def record_mcap(
    episode: Episode,
    client: "CellClient",
    cell: "CellConfig",
    security: "LinkSecurity | None",
    say: Callable[[str], None],
    stack: ExitStack,
) -> Callable[[str], None]:
    """Record the run from here on, until `stack` ends; returns `say` with each line recorded as well.

    Raises:
        ConfigError: The file cannot be written.
        RobotGoneError: Nobody answers at the endpoint.
    """
    from replan.run.mcap_recording import FILE_NAME, RunRecording

    recording = RunRecording(episode.folder / FILE_NAME, client.endpoint, cell, security, say)
    stack.callback(recording.close)
    episode.on_event, client.on_frame = recording.event, recording.frame
    return recording.telling(say)


def _write_film(film: Film, episode: Episode, options: "RecordingOptions", say: Callable[[str], None]) -> None:
    with held_back():  # a second Ctrl-C must not leave half a file
        if options.strip and film.write_strip(episode.folder / "strip.png"):
            say(f"pictures: {episode.folder / 'strip.png'}")
        if options.video:
            film.write_video(episode.folder / "run.mp4")
