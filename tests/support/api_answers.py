"""What every answer of the API does, and that a command gives the same."""

import json

import pytest


def same(shell, found, *command):
    """The command's JSON, to the last digit and in the same order."""
    assert shell(*command, "--json", "-") == 0, shell.err
    assert found.json == shell.out and found.to_dict() == json.loads(shell.out)
    assert len(found.json) > 200
    return found


def behaves(found):
    """What every answer does."""
    assert repr(found).startswith(f"<{type(found).__name__}: ") and len(repr(found)) < 500
    html = found._repr_html_()
    assert html.startswith("<p><b>") and html.count("<tr>") > 1
    frame, arrays = found.to_pandas(), found.to_xarray()
    assert len(frame) > 0 and all(len(variable) == len(frame) for variable in arrays.variables.values())
    with pytest.raises(AttributeError):
        found.notes = ()
