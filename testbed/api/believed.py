"""What a function of the API is given: a model, effects and records, each by its file or as an object; and what it refuses."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from testbed.problem import InputProblem

if TYPE_CHECKING:
    from testbed.effect import Effect
    from testbed.files.campaign import Campaign
    from testbed.machine import Model
    from testbed.store.data_set import DataSet

File: TypeAlias = "str | os.PathLike[str]"
ModelLike: TypeAlias = "File | Model"
CampaignLike: TypeAlias = "File | Campaign"
DataLike: TypeAlias = "File | Campaign | DataSet"
EffectsLike: TypeAlias = "File | Effects | Sequence[File]"


@dataclass(frozen=True, eq=False, repr=False)
class Effects(Mapping[str, "Effect"]):
    """The effects known, by name: those of the catalogue, and those of folders of one's own."""

    known: Mapping[str, Effect]
    folders: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> Effect:
        return self.known[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.known)

    def __len__(self) -> int:
        return len(self.known)

    def __repr__(self) -> str:
        own = f", with those of {', '.join(self.folders)}" if self.folders else ""
        return f"<Effects: {', '.join(self.known)}{own}>"

    def _repr_html_(self) -> str:
        from html import escape

        rows = "".join(f"<tr><td>{escape(name)}</td><td>{escape(one.title)}</td></tr>" for name, one in self.known.items())
        return f"<table><thead><tr><th>effect</th><th>what it is</th></tr></thead><tbody>{rows}</tbody></table>"


def effects_of(given: EffectsLike) -> Effects:
    """The effects known with these folders of one's own. InputProblem names a file that breaks the contract."""
    if isinstance(given, Effects):
        return given
    from testbed.catalogue import catalogue

    folders = (given,) if isinstance(given, (str, os.PathLike)) else tuple(given)
    named = tuple(os.fspath(folder) for folder in folders)
    return Effects(catalogue(*named), named)


def model_of(given: ModelLike, catalogue: Mapping[str, Effect]) -> tuple[Model, str]:
    """(a model, its name for messages): read where a file is named. InputProblem."""
    from testbed.catalogue import unknown_effect
    from testbed.files.model_file import read_model
    from testbed.machine import Model

    if isinstance(given, (str, os.PathLike)):
        return read_model(Path(given), catalogue), os.fspath(given)
    if not isinstance(given, Model):
        raise InputProblem("model", f"a {type(given).__name__} is no model", "give a model.yaml, or testbed.load of one")
    name = given.file or "the model"
    for effect in given.effects:
        if effect not in catalogue:
            raise InputProblem(name, f"has the unknown effect '{effect}'", unknown_effect(effect, catalogue))
    return given, name


def name_of(given: DataLike | ModelLike) -> str:
    """The name of a campaign, a data set or a model for messages: its file's."""
    if isinstance(given, (str, os.PathLike)):
        return os.fspath(given)
    return str(getattr(given, "file", "") or getattr(given, "path", "") or f"the {type(given).__name__.lower()}")


def cutting_model(given: ModelLike, catalogue: Mapping[str, Effect], otherwise: str = "") -> tuple[Model, str]:
    """A model that has a cutter, and its name. InputProblem, with what to do `otherwise`, where it has none."""
    model, name = model_of(given, catalogue)
    check_cutting(model, name, otherwise)
    return model, name


def check_cutting(model: Model, path: str, otherwise: str = "") -> None:
    """InputProblem, with what to do `otherwise`, where a model has no cutter."""
    if model.cutter is None:
        raise InputProblem(path, "has no cutter and cutting", f"add both: this command is about a cut{otherwise}")


def refuse_planar(model: Any, place: str, instead: str) -> None:
    """InputProblem where a model has more than the one mode along the feed, with what to do instead."""
    if model.planar:
        raise InputProblem(place, "has modes beyond one of the workpiece along x, or a pitch for each tooth", instead)


def in_the_work(model: Any) -> tuple[Any, list[str]]:
    """A machine without loss of contact where it has no other effect, and a note: a linear answer is for teeth in the work.

    Beside other effects it stays: a cut in which teeth leave the work for long has no linear answer then.
    """
    if "contact_loss" not in model.effects:
        return model, []
    note = ["contact_loss is left out: this is an answer for teeth that stay in the work"]
    return (model.without_effect("contact_loss") if set(model.effects) == {"contact_loss"} else model), note


def guesses_note(model: Any) -> list[str]:
    """A line where a model has parameters that no record told: what it foretells is a guess as far as it hangs on them."""
    told = ", ".join(f"{path} ({model.value(path):.4g})" for path in model.not_determined)
    return [f"guesses, not determined by the records behind this model: {told}; what follows hangs on them"] if told else []
