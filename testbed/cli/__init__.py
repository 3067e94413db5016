"""The command line: `testbed COMMAND`. Each command is one file of this folder, found by looking.

A command's file defines `command`, or a command of the file's own name. Heavy packages are imported inside its
functions, so that `--help` answers at once.
"""

from __future__ import annotations

import errno
import os
import sys
from importlib import import_module
from pathlib import Path
from typing import NoReturn

import click

from testbed.problem import InputProblem, shortened

FOLDER = Path(__file__).parent
# The order of `testbed --help`, along a user's way; a command not named here comes after, by the alphabet.
ORDER = ("demo", "run", "identify", "score", "export", "chart", "multipliers", "inspect", "verify", "compare", "diagnose",
         "add", "effects", "paper", "view", "doctor")


MOST_SAID = 900  # characters of an error's one line
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


class Commands(click.Group):
    """The commands found in this folder, imported when asked for."""

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
    """Run a command line; exits with 0 (done), 2 (bad input), 130 (interrupted) or 1 (a fault of the program)."""
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # results would change with the number of BLAS threads
    try:
        code = testbed.main(arguments, prog_name="testbed", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as asked:
        click.echo(asked.format_message())
        code = 0
    except click.UsageError as problem:
        _complain(_usage(problem))
        code = 2
    except click.ClickException as problem:
        _complain(problem.format_message())
        code = 2
    except InputProblem as problem:
        _complain(str(problem))
        code = 2
    except (KeyboardInterrupt, click.Abort) as stop:
        said = str(stop) or str(stop.__cause__ or "")  # click wraps the interruption in an Abort of its own
        click.echo(f"interrupted: {said}" if said else "interrupted", err=True)
        code = 130
    except BrokenPipeError:  # the reader, such as `head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    except MemoryError as problem:
        said = str(problem).rstrip(".") or "no more was given"
        _complain(f"out of memory ({said}): close other programs, or give less at once: from and to read a part of a record")
        code = 2
    except OSError as problem:
        if problem.errno == errno.ENOMEM:
            _complain("out of memory: close other programs, or give less at once")
            sys.exit(2)
        if problem.errno not in _NO_ROOM:
            raise
        place = problem.filename or "the output"
        _complain(f"{place}: cannot be written ({problem.strerror}): make room, or choose another place")
        code = 2
    sys.exit(code if isinstance(code, int) else 0)


def _complain(text: str) -> None:
    click.echo("error: " + shortened(text, MOST_SAID), err=True)


def _usage(problem: click.UsageError) -> str:
    """click's complaint in the one line that every bad input gets."""
    command = problem.ctx.command_path if problem.ctx else "testbed"
    said = problem.format_message().rstrip(".")
    return f"{command}: {said[:1].lower() + said[1:]}: see {command} --help"
