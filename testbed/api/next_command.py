"""The command to go on with after a diagnosis, as it is typed."""

from __future__ import annotations

import shlex
from typing import Any


def next_command(found: Any, campaign: str, model_file: str, proposed: bool, folders: tuple[str, ...] = ()) -> str:
    """The command to go on with; empty where there is none, or where it is told with what was proposed.

    folders: of the user's own effects, which the command will know no more than this one did without them. proposed: whether a
    force was asked for already. A missing mode is written into the file by hand.
    """
    if found.mode:
        return ""
    if found.verdict == "missing_effect":
        return add_command(found.effects, campaign, model_file, folders)
    if found.verdict == "unexplained" and found.candidates and not proposed:  # without candidates no effect was looked for
        return shlex.join(["testbed", "diagnose", campaign, "-m", model_file, *_own(folders), "--propose", "DIR"])
    return ""


def add_command(effects: tuple[str, ...], campaign: str, model_file: str, folders: tuple[str, ...]) -> str:
    """The command that adds effects to the model, folders of one's own named."""
    return shlex.join(["testbed", "add", *effects, "-m", model_file, "-c", campaign, *_own(folders), "-o", "NEW.yaml"])


def _own(folders: tuple[str, ...]) -> list[str]:
    return [word for folder in folders for word in ("--effects", folder)]
