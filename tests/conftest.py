"""What holds for the whole suite."""

import signal


def pytest_configure() -> None:
    """Tests send SIGINT to themselves and to their children, also where a script's shell has it ignored."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
