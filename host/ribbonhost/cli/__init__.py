"""The command line: one place turns what went wrong into a message and an exit code."""

import os
import sys

from ribbonhost.errors import RibbonError


def main() -> None:
    """Runs `ribbonhost`; exits with 0 on success, 1 on failure, 2 on wrong usage."""
    from ribbonhost.cli.app import build_app

    try:
        try:
            build_app()(prog_name="ribbonhost")
        finally:
            sys.stdout.flush()  # here a reader that left can be met quietly, at the interpreter's exit not
    except RibbonError as error:
        print(f"ribbonhost: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:
        forget_stdout()
        sys.exit(0)
    except Exception as error:
        if os.environ.get("RIBBONHOST_DEBUG"):
            raise
        print(
            f"ribbonhost: a defect of this program: {type(error).__name__}: {error} "
            "(RIBBONHOST_DEBUG=1 shows where; please report it)",
            file=sys.stderr,
        )
        sys.exit(1)


def forget_stdout() -> None:
    """Nobody reads what is printed any more (`| head`): print the rest nowhere, so that the exit is quiet."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
