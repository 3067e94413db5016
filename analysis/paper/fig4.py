"""Fig. 4: the rig, rendered from its MuJoCo model."""

from __future__ import annotations

from testbed.analysis.paper.bench import Bench
from testbed.analysis.paper.part import Part, Picture

VIEWS = {"overview": "The flexure on its two leaf springs, the specimen and the cutter, in mid-cut.",
         "cut": "The cut itself: the specimen under the single-flute cutter."}


def make(bench: Bench) -> Part:
    """The part."""
    pictures, problem = [], "nothing here can render" if bench.render is None else ""
    for camera, caption in VIEWS.items():
        if bench.render is None:
            break
        try:
            bench.render(bench.folder / f"fig4_{camera}.png", camera)
        except RuntimeError as failure:
            problem = str(failure)
            break
        pictures.append(Picture(f"fig4_{camera}", caption, None, 0.5))
    text: tuple[str, ...] = (
        "The paper shows a photograph; this is the simulated rig. Mass, frequency and damping of the mode are the sister "
        "papers'; the shape of the leaves is a working choice that gives this stiffness.",)
    if problem:
        text += (f"No picture: {problem}.",)
    return Part("fig4", "Figure 4: the experiment", text, tuple(pictures), (), (), {"problem": problem})
