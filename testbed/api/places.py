"""Where an answer may be written: a file that can be, a folder that is made, a report's page."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from testbed.problem import InputProblem

if TYPE_CHECKING:
    from testbed.api.believed import File
    from testbed.effect import Effect
    from testbed.machine import Model

LONGEST_NAME = 235  # bytes: file systems take 255, and a file is first written under a longer name
PAGE = "report.html"


def check_place(path: File | None) -> None:
    """InputProblem where a file could not be written, found before the work rather than after it."""
    if path is None:
        return
    target = Path(path)
    folder = target.parent
    if len(os.fsencode(target.name)) > LONGEST_NAME:
        raise InputProblem(f"{target.name[:40]}...", "is too long a name for a file", "choose a shorter one")
    if os.path.isdir(target):
        raise InputProblem(path, "is a folder", "name a file")
    if not os.path.isdir(folder):
        raise InputProblem(path, f"there is no folder {folder}", "make it first, or choose another place")
    if not os.access(folder, os.W_OK):
        raise InputProblem(path, "cannot be written (permission denied)", "choose another place")


def save_fitted(model: Model, path: File, effects: Mapping[str, Effect]) -> Path:
    """Write a model that was fitted as a model.yaml, with what of it no machine has as remarks. InputProblem."""
    from testbed.analysis.fit.plausible import unlike_a_machine
    from testbed.files.model_file import write_model

    check_place(path)
    write_model(model, Path(path), effects, unlike_a_machine(model))
    return Path(path)


def made_folder(path: File) -> Path:
    """A folder for pictures and reports, made if need be. InputProblem where it cannot be made or written to."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise InputProblem(path, f"cannot be made ({problem.strerror})", "choose another place") from None
    if not os.access(folder, os.W_OK):
        raise InputProblem(path, "cannot be written (permission denied)", "choose another place")
    return folder


def page_place(path: File) -> Path:
    """Where a report's page goes: the .html file named, or report.html in the folder named, which is made if need be."""
    target = Path(path)
    if target.suffix.lower() in (".html", ".htm"):
        check_place(target)
        return target
    return made_folder(target) / PAGE
