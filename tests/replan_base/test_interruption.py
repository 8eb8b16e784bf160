"""Signals that ask the program to end raise where it is, or wait until what must not be left half done is done."""

import signal
import threading

import pytest

from replan.errors import exit_code
from replan_base.interruption import EndedBySignal, ending_signals, held_back, raise_on_signals

CODES = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}
SIGNALS = pytest.mark.parametrize("number", list(CODES), ids=lambda number: number.name)


@pytest.fixture(autouse=True)
def handlers_as_before():
    before = {number: signal.getsignal(number) for number in CODES}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@SIGNALS
def test_a_signal_raises_with_the_exit_code_that_shells_use_even_where_it_was_ignored(number):
    if number != signal.SIGHUP:
        signal.signal(number, signal.SIG_IGN)
    raise_on_signals()
    with pytest.raises(KeyboardInterrupt) as caught:
        signal.raise_signal(number)
    assert exit_code(caught.value) == CODES[number]
    if number != signal.SIGINT:
        assert isinstance(caught.value, EndedBySignal) and str(caught.value) == f"ended by {number.name}"


def test_a_hangup_that_nohup_ignores_stays_ignored():
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    assert ending_signals() == [signal.SIGINT, signal.SIGTERM]
    raise_on_signals()
    signal.raise_signal(signal.SIGHUP)
    with held_back() as came:
        signal.raise_signal(signal.SIGHUP)
        assert not came()
    assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN


@SIGNALS
def test_a_signal_that_is_held_back_is_noticed_and_raises_nothing(number):
    raise_on_signals()
    with held_back() as came:
        assert not came()
        signal.raise_signal(number)
        assert came()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)


def test_on_another_thread_nothing_is_held_back_and_nothing_breaks():
    told = []

    def inside():
        with held_back() as came:
            told.append(came())

    thread = threading.Thread(target=inside)
    thread.start()
    thread.join()
    assert told == [False]
