"""The `replan` command: parse, run one function, print its result. Nothing heavy is imported before it is needed."""

import sys


def main() -> None:
    """Entry point; ends the process with the exit codes of `replan.errors`."""
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
    from replan.console import Console
    from replan.errors import EXPECTED_ERRORS, INTERRUPTED, exit_code

    console = Console(json=command.json)
    try:
        return command.execute(console)
    except EXPECTED_ERRORS as error:
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
