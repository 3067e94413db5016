"""The command line: `testbed COMMAND`. Each command is one file of this folder, found by looking.

A command's file defines `command`, or a command of the file's own name. Heavy packages are imported inside its
functions, so that `--help` answers at once.
"""

from __future__ import annotations

import errno
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

import click

from testbed.api.working import home_for_pictures, one_thread_from_the_start
from testbed.files.door import is_shortage
from testbed.problem import InputProblem, InputWarning, shortened
from testbed.system.interruption import INTERRUPTED, interrupted, leave, listen, say_interrupted

FOLDER = Path(__file__).parent
# The order of `testbed --help`, along a user's way; a command not named here comes after, by the alphabet.
ORDER = ("demo", "init", "tap", "run", "identify", "score", "export", "chart", "multipliers", "inspect", "verify", "compare",
         "diagnose", "add", "plan", "effects", "paper", "view", "doctor")


_OUT_OF_MEMORY = "out of memory: close other programs, or give less at once, such as part of a record by from and to"
MOST_SAID = 900  # characters of an error's one line
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


class Stop(BaseException):
    """A KeyboardInterrupt under another name: click answers that one with an empty line."""


class Commands(click.Group):
    """The commands found in this folder, imported when asked for."""

    def invoke(self, context: click.Context) -> Any:
        """As click's, but an interruption reaches `main`."""
        try:
            return super().invoke(context)
        except KeyboardInterrupt as stop:
            raise Stop(str(stop)) from None

    def list_commands(self, context: click.Context) -> list[str]:
        """Names, in the order of the help."""
        found = sorted(path.stem for path in FOLDER.glob("*.py") if not path.stem.startswith("_"))
        return [name for name in ORDER if name in found] + [name for name in found if name not in ORDER]

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        """The command of that name, or None."""
        if name not in self.list_commands(context):
            return None
        module = import_module(f"testbed.cli.{name}")
        return vars(module).get("command") or vars(module)[name]

    def resolve_command(self, context: click.Context, args: list[str]) -> tuple:
        """As click's, but a misspelt name is answered with the nearest known one."""
        from testbed.units import nearest

        name = args[0] if args else ""
        if name and not name.startswith("-") and self.get_command(context, name) is None:
            close = nearest(name, self.list_commands(context))
            raise click.UsageError(f"there is no command '{name}'" + (f": did you mean {close}?" if close else ""), context)
        return super().resolve_command(context, args)


@click.command(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
               epilog="Example: testbed run published_tests -o tests.h5 && testbed score tests.h5")
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, help="Show the version and exit.",
              callback=lambda context, option, asked: _show_version(context) if asked else None)
def testbed() -> None:
    """A virtual machining testbed: cut metal in simulation, identify the machine from its vibration, and learn which
    physical effect a model lacks.

    A scenario (YAML) says what to cut; a model.yaml what is believed of the machine; a campaign.yaml what was measured.
    """


def _show_version(context: click.Context) -> None:
    from importlib.metadata import PackageNotFoundError, version

    try:
        click.echo(f"testbed {version('machining-testbed')}")
    except PackageNotFoundError:  # run from its source
        click.echo("testbed, not installed")
    context.exit()


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run a command line; exits with 0 (done), 2 (bad input), 130 (interrupted) or 1 (a fault of the program).

    arguments: without them, those that were typed, of a process whose end this is.
    """
    one_thread_from_the_start()
    home_for_pictures()
    restore = listen()
    try:
        code = _code(arguments)
    finally:
        if arguments is not None:
            restore()
    if arguments is None:
        leave(code)
    sys.exit(code)


def _code(arguments: list[str] | None) -> int:
    """The exit code of a command line, whose fault is said in one line."""
    try:
        with _told_warnings():
            code = testbed.main(arguments, prog_name="testbed", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as asked:
        click.echo(asked.format_message())
        return 0
    except click.UsageError as problem:
        return _complain(_usage(problem))
    except click.ClickException as problem:
        return _complain(problem.format_message())
    except InputProblem as problem:
        return _complain(str(problem))
    except (KeyboardInterrupt, Stop, click.Abort) as stop:
        say_interrupted(str(stop))
        return INTERRUPTED
    except MemoryError:
        return _complain(_OUT_OF_MEMORY)
    except BrokenPipeError:  # the reader, such as `head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except BaseException as problem:
        if interrupted():  # what was struck made something else of it
            say_interrupted("")
            return INTERRUPTED
        if is_shortage(problem):
            return _complain(_OUT_OF_MEMORY)
        if not isinstance(problem, OSError) or problem.errno not in _NO_ROOM:
            raise
        place = problem.filename or "the output"
        return _complain(f"{place}: cannot be written ({problem.strerror}): make room, or choose another place")
    return code if isinstance(code, int) else 0


@contextmanager
def _told_warnings() -> Iterator[None]:
    """What is to be known of an input, in a line of its own; a program's other warnings as Python shows them."""
    with warnings.catch_warnings():
        usual = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *where: Any) -> None:
            if issubclass(category, InputWarning):
                click.echo(f"warning: {' '.join(str(message).split())}", err=True)
            else:
                usual(message, category, *where)

        warnings.simplefilter("once", InputWarning)
        warnings.showwarning = show  # type: ignore[assignment]
        yield


def _complain(text: str) -> int:
    click.echo("error: " + shortened(text, MOST_SAID), err=True)
    return 2


def _usage(problem: click.UsageError) -> str:
    """click's complaint in the one line that every bad input gets."""
    command = problem.ctx.command_path if problem.ctx else "testbed"
    said = problem.format_message().rstrip(".")
    return f"{command}: {said[:1].lower() + said[1:]}: see {command} --help"
