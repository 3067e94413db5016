"""Virtual machining testbed: simulate a flexible workpiece being milled, and learn what a model of it lacks.

    import testbed

    model = testbed.load("model.yaml")
    campaign = testbed.load("campaign.yaml")
    found = testbed.compare(campaign, model)
    found.plot()

Every command of the command line is a function of the same name here and gives the same answer, as a frozen object: with
`.plot()`, `.to_pandas()`, `.to_xarray()`, `.report(folder)` where the command writes a page, and `.json`, what the command
writes with `--json`. Quantities are texts with their units ("3810 rpm", "2.9 mm") or plain numbers in SI units (rad/s, m).
Bad input raises `testbed.InputProblem`, a ValueError, with the command's one line. Nothing heavy is loaded before it is used.
"""

import sys
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path
from typing import TYPE_CHECKING, Any

if not (Path(__file__).parent / "analysis").is_dir():  # a source tree, where these stand beside: a wheel holds them inside

    class _Beside:
        """Finds those three alone: the root itself in `__path__` would hold this package once more, and that one again."""

        @staticmethod
        def find_spec(name: str, path: object = None, target: object = None) -> ModuleSpec | None:
            if name not in ("testbed.analysis", "testbed.models", "testbed.scenarios"):
                return None
            folder = Path(__file__).parents[1] / name.removeprefix("testbed.")
            return spec_from_file_location(name, folder / "__init__.py", submodule_search_locations=[str(folder)])

    sys.meta_path.append(_Beside)  # type: ignore[arg-type]

if TYPE_CHECKING:
    from testbed.api.add import Addition as Addition
    from testbed.api.add import add as add
    from testbed.api.believed import Effects as Effects
    from testbed.api.chart import Chart as Chart
    from testbed.api.chart import chart as chart
    from testbed.api.compare import Comparison as Comparison
    from testbed.api.compare import Waveform as Waveform
    from testbed.api.compare import compare as compare
    from testbed.api.diagnose import Diagnosis as Diagnosis
    from testbed.api.diagnose import FalseAlarms as FalseAlarms
    from testbed.api.diagnose import Proposal as Proposal
    from testbed.api.diagnose import diagnose as diagnose
    from testbed.api.effects import effect_card as effect_card
    from testbed.api.effects import list_effects as list_effects
    from testbed.api.effects import new_effect as new_effect
    from testbed.api.export import TrainingSet as TrainingSet
    from testbed.api.export import export as export
    from testbed.api.identify import Identification as Identification
    from testbed.api.identify import identify as identify
    from testbed.api.inspect import Inspection as Inspection
    from testbed.api.inspect import inspect as inspect
    from testbed.api.load import load as load
    from testbed.api.multipliers import Multipliers as Multipliers
    from testbed.api.multipliers import multipliers as multipliers
    from testbed.api.plan import Plan as Plan
    from testbed.api.plan import plan as plan
    from testbed.api.score import Score as Score
    from testbed.api.score import score as score
    from testbed.api.simulate import simulate as simulate
    from testbed.api.sweep import Sweep as Sweep
    from testbed.api.sweep import Workers as Workers
    from testbed.api.sweep import sweep as sweep
    from testbed.api.tap import TapTest as TapTest
    from testbed.api.tap import tap as tap
    from testbed.api.verify import Verification as Verification
    from testbed.api.verify import verify as verify
    from testbed.cutter import Cutter as Cutter
    from testbed.files.campaign import Campaign as Campaign
    from testbed.files.taps_file import Taps as Taps
    from testbed.machine import Cutting as Cutting
    from testbed.machine import Model as Model
    from testbed.problem import InputProblem as InputProblem
    from testbed.problem import InputWarning as InputWarning
    from testbed.recording import Recording as Recording
    from testbed.scenario.scenario import Scenario as Scenario
    from testbed.store.data_set import DataSet as DataSet
    from testbed.structure import Mode as Mode
    from testbed.structure import Structure as Structure

    __version__: str

# Where each public name is found once it is asked for.
_HOMES = {
    "testbed.api.add": ("Addition", "add"),
    "testbed.api.believed": ("Effects",),
    "testbed.api.chart": ("Chart", "chart"),
    "testbed.api.compare": ("Comparison", "Waveform", "compare"),
    "testbed.api.diagnose": ("Diagnosis", "FalseAlarms", "Proposal", "diagnose"),
    "testbed.api.effects": ("effect_card", "list_effects", "new_effect"),
    "testbed.api.export": ("TrainingSet", "export"),
    "testbed.api.identify": ("Identification", "identify"),
    "testbed.api.inspect": ("Inspection", "inspect"),
    "testbed.api.load": ("load",),
    "testbed.api.multipliers": ("Multipliers", "multipliers"),
    "testbed.api.plan": ("Plan", "plan"),
    "testbed.api.score": ("Score", "score"),
    "testbed.api.simulate": ("simulate",),
    "testbed.api.sweep": ("Sweep", "Workers", "sweep"),
    "testbed.api.tap": ("TapTest", "tap"),
    "testbed.api.verify": ("Verification", "verify"),
    "testbed.cutter": ("Cutter",),
    "testbed.files.campaign": ("Campaign",),
    "testbed.files.taps_file": ("Taps",),
    "testbed.machine": ("Cutting", "Model"),
    "testbed.problem": ("InputProblem", "InputWarning"),
    "testbed.recording": ("Recording",),
    "testbed.scenario.scenario": ("Scenario",),
    "testbed.store.data_set": ("DataSet",),
    "testbed.structure": ("Mode", "Structure"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}
__all__ = ["__version__", *sorted(_HOME_OF)]


def __getattr__(name: str) -> Any:
    """A public name, loaded now (PEP 562)."""
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            found: Any = version("machining-testbed")
        except PackageNotFoundError:  # run from its source
            found = "0+source"
    elif name in _HOME_OF:
        from importlib import import_module

        found = getattr(import_module(_HOME_OF[name]), name)
    else:
        raise AttributeError(f"module 'testbed' has no attribute '{name}'")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
