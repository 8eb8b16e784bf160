"""The `replan` command: parse, run one function, print its result. Nothing heavy is imported before it is needed."""

import sys

from replan.console import Console
from replan_base.errors import ForeignPackageError, ReplanError
from replan_base.packages import require_own_packages


def main() -> None:
    """Entry point; ends the process with the exit codes of `replan.errors`."""
    try:
        require_own_packages()
    except ForeignPackageError as error:
        Console(json="--json" in sys.argv).fail(error)  # before the arguments are parsed: that imports all commands
        sys.exit(1)
    import tyro

    from replan.commands import COMMANDS

    command = tyro.extras.subcommand_cli_from_dict(
        COMMANDS,
        prog="replan",
        description="A typed goal moves a Panda: look, plan with language models, find motions in a MuJoCo twin, "
        "judge them there, execute, look again.",
    )
    sys.exit(_run(command))


def _run(command) -> int:
    from replan.errors import INTERRUPTED, exit_code

    console = Console(json=command.json)
    try:
        return command.execute(console)
    except ReplanError as error:
        console.fail(error)
        return exit_code(error)
    except KeyboardInterrupt:
        console.note("interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of our output went away (for instance `| head`); there is nobody left to tell.
        sys.stderr.close()
        return 1


if __name__ == "__main__":
    main()
