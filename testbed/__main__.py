"""The command line: `testbed`, or `python -m testbed` where that is not on the path. From here on signals are answered."""

from typing import NoReturn

from testbed.system.interruption import INTERRUPTED, interrupted, leave, listen, say_interrupted


def main() -> NoReturn:
    """Run the command line that was typed."""
    listen()
    try:
        from testbed.cli import main as run

        run()
    except SystemExit:
        raise
    except BaseException:  # while that was imported
        if not interrupted():
            raise
        say_interrupted("")
        leave(INTERRUPTED)


if __name__ == "__main__":
    main()
