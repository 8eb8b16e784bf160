"""The `replan` command: parse, run one function, print its result. Nothing heavy is imported before it is needed."""

import sys

from replan.console import Console
from replan_base import __version__
from replan_base.errors import ForeignPackageError, ReplanError
from replan_base.interruption import raise_on_signals
from replan_base.packages import require_own_packages
from replan_base.parts import missing_parts_named


def main() -> None:
    """Entry point; ends the process with the exit codes of `replan.errors`.

    Ctrl-C, SIGTERM and SIGHUP bring an arm that was set in motion to rest, also where the shell ignores Ctrl-C.
    """
    if sys.argv[1:] == ["--version"]:
        print(f"replan {__version__}")
        return
    raise_on_signals()
    console = Console(json="--json" in sys.argv)
    try:
        require_own_packages()  # before the arguments are parsed: that imports all commands
        command = _parsed()
    except ForeignPackageError as error:
        console.fail(error)
        sys.exit(1)
    except ReplanError as error:  # options check themselves when they are made
        from replan.errors import exit_code

        console.fail(error)
        sys.exit(exit_code(error))
    except KeyboardInterrupt as end:
        sys.exit(_interrupted(end, console))
    sys.exit(_run(command))


def _parsed():
    import tyro

    from replan.commands import COMMANDS

    return tyro.extras.subcommand_cli_from_dict(
        COMMANDS,
        prog="replan",
        description="A typed goal moves a Panda: look, plan with language models, find motions in a MuJoCo twin, "
        "judge them there, execute, look again.",
    )


def _run(command) -> int:
    from replan.errors import exit_code

    console = Console(json=command.json)
    try:
        with missing_parts_named():
            return command.execute(console)
    except ReplanError as error:
        console.fail(error)
        return exit_code(error)
    except KeyboardInterrupt as end:
        return _interrupted(end, console)
    except BrokenPipeError:
        # The reader of our output went away (for instance `| head`); there is nobody left to tell.
        sys.stderr.close()
        return 1


def _interrupted(end: KeyboardInterrupt, console: Console) -> int:
    from replan.errors import exit_code

    console.note(str(end) or "interrupted")
    return exit_code(end)


if __name__ == "__main__":
    main()
