"""Signals that ask the program to end: raised as exceptions, so that an arm in motion comes to rest first."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class EndedBySignal(KeyboardInterrupt):
    """SIGTERM or SIGHUP; whatever handles Ctrl-C handles it likewise.

    Attributes:
        number: The signal.
    """

    def __init__(self, number: int) -> None:
        self.number = signal.Signals(number)
        super().__init__(f"ended by {self.number.name}")


def ending_signals() -> list[signal.Signals]:
    """SIGINT, SIGTERM and SIGHUP; the last only where it is not ignored, which is what `nohup` asks for.

    SIGINT is among them also where it is ignored: a script's shell starts every background job so, and whoever sends it
    to such a job still wants the arm to rest.
    """
    nohup = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    return [signal.SIGINT, signal.SIGTERM] + [signal.SIGHUP] * (not nohup)


def raise_on_signals() -> None:
    """From now on SIGINT raises KeyboardInterrupt in the main thread, SIGTERM and SIGHUP raise EndedBySignal.

    Raises:
        ValueError: Called on another thread than the main one.
    """
    for number in ending_signals():
        signal.signal(number, signal.default_int_handler if number == signal.SIGINT else _raise)


@contextmanager
def held_back() -> Iterator[Callable[[], bool]]:
    """Inside, the signals raise nothing; calling what is given says whether one came.

    For what must not be left half done, such as a file. On another thread than the main one nothing changes: signals
    raise on the main thread alone.
    """
    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    before = {number: signal.signal(number, lambda number, _: came.append(number)) for number in ending_signals()}
    try:
        yield lambda: bool(came)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _raise(number: int, _: object) -> None:
    raise EndedBySignal(number)
