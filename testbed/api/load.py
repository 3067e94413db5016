"""What a file or a folder is, read: a model, a campaign, taps, a scenario, a data set, effects of one's own."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, overload

from testbed.api.believed import EffectsLike, File, effects_of
from testbed.problem import InputProblem

if TYPE_CHECKING:
    from testbed.files.campaign import Campaign
    from testbed.files.taps_file import Taps
    from testbed.files.yaml_text import Document

Kind = TypeVar("Kind")
# What tells a YAML file of each kind from the others: keys that it alone has.
_KEYS = {"campaign": ("records",), "taps": ("taps",), "scenario": ("model", "tests", "sweep"), "model": ("structure",)}


@overload
def load(path: File, kind: None = None, *, effects: EffectsLike = (), folder: File | None = None) -> Any: ...
@overload
def load(path: File, kind: type[Kind], *, effects: EffectsLike = (), folder: File | None = None) -> Kind: ...


def load(path: File, kind: type[Any] | None = None, *, effects: EffectsLike = (), folder: File | None = None) -> Any:
    """Read what a file or a folder is: a model.yaml (Model), a campaign.yaml (Campaign), a taps.yaml (Taps), a scenario
    (Scenario), a data set of `testbed run` (DataSet; its samples stay on disk until they are asked for), or a folder of effects
    (Effects).

    kind: what it has to be, for type checkers and for a clear error: `testbed.load("model.yaml", testbed.Model)`. effects:
    folders of one's own effects that a model or a scenario may name. folder: where a campaign's files are, if not beside it.
    Raises InputProblem where it is none of these, or not whole.
    """
    found = _loaded(Path(path), effects, folder)
    if kind is not None and not isinstance(found, kind):
        raise InputProblem(path, f"is a {type(found).__name__}, no {kind.__name__}", "name another file")
    return found


def _loaded(path: Path, effects: EffectsLike, folder: File | None) -> Any:
    from testbed.store.data_set import is_data_set, read_data_set

    if path.suffix.lower() in (".yaml", ".yml"):
        return _of_yaml(path, effects, folder)
    if is_data_set(path) or path.suffix.lower() in (".h5", ".hdf5"):
        return read_data_set(path)
    if path.is_dir():
        if not any(path.glob("*.py")):
            raise InputProblem(path, "is a folder without effects, and no data set", "name a file in it")
        own = effects_of(effects)
        return effects_of((*own.folders, os.fspath(path)))
    if not path.exists():
        raise InputProblem(path, "there is no such file", "check the path")
    raise InputProblem(path, "is no data set of `testbed run`, and no YAML file",
                       "testbed.inspect looks a measured file over; to fit it, name it in a campaign.yaml")


def _of_yaml(path: Path, effects: EffectsLike, folder: File | None) -> Any:
    from testbed.files import yaml_text

    document = yaml_text.load(path)
    kind = _kind(document)
    if kind == "campaign":
        return _campaign(path, folder)
    if kind == "taps":
        return _taps(path, folder)
    if kind == "scenario":
        from testbed.scenario.scenario_file import read_scenario

        return read_scenario(os.fspath(path), effects_of(effects).known)
    if kind == "model":
        from testbed.files.model_file import read_model

        return read_model(path, effects_of(effects).known)
    raise InputProblem(path, "is no model, campaign, taps or scenario",
                       "the first has the key structure, the others records, taps, and tests")


def _campaign(path: Path, folder: File | None) -> Campaign:
    from testbed.files.campaign import load_campaign

    return load_campaign(path, None if folder is None else Path(folder))


def _taps(path: Path, folder: File | None) -> Taps:
    from testbed.files.taps_file import load_taps

    return load_taps(path, None if folder is None else Path(folder))


def _kind(document: Document) -> str | None:
    """What a YAML file is, by its keys."""
    keys = set(document.data)
    return next((kind for kind, own in _KEYS.items() if keys.intersection(own)), None)
