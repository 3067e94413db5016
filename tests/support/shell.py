"""The command line, called as a shell calls it."""

import json
from pathlib import Path

import pytest

from testbed.cli import main


class Shell:
    """Runs command lines in the folder it stands in; keeps what they print."""

    def __init__(self, capsys):
        self.capsys = capsys

    def __call__(self, *arguments):
        self.capsys.readouterr()
        with pytest.raises(SystemExit) as stop:
            main([str(argument) for argument in arguments])
        self.out, self.err = self.capsys.readouterr()
        return stop.value.code

    def json(self, *arguments):
        """The JSON a good call answers with; no number in it is NaN or infinite."""
        assert self(*arguments, "--json", "-") == 0, self.err
        return json.loads(self.out, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))

    def refused(self, *arguments):
        """The one line that a bad call is answered with; nothing may be written."""
        before = sorted(Path().rglob("*"))
        assert self(*arguments) == 2, self.out
        assert self.err.startswith("error: ") and self.err.count("\n") == 1 and self.out == ""
        assert sorted(Path().rglob("*")) == before
        return self.err
