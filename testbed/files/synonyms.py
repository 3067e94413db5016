"""Words of the shop and of other programs for the keys of the files here, and what to write instead.

A foreign word is answered, never taken: `radial_immersion` is a_e / D elsewhere, while `immersion` here is the share of the
spindle period that a tooth cuts, and 0.5 is half an immersion there and a slot here.
"""

from __future__ import annotations

from collections.abc import Iterable

_RADIAL = ("radial_depth, the width of cut a_e as a length (immersion is the share of the spindle period that a tooth cuts, "
           "not a_e / D)")  # fmt: skip
_STIFFNESS = "mass, which is the stiffness over (2 pi natural_frequency)^2, or a list of modes, which takes a stiffness"
# (words, key that is meant, what to write where that says more)
_WORDS: tuple[tuple[str, str, str], ...] = (
    ("ae a_e radial_depth_of_cut width_of_cut radial_width stepover", "radial_depth", ""),
    ("radial_immersion radial_engagement ae_d immersion_ratio radial_immersion_ratio", "radial_depth", _RADIAL),
    ("ap a_p axial_depth axial_depth_of_cut doc depth b", "depth_of_cut", ""),
    ("ap a_p axial_depth depth_of_cut doc depth b", "axial_depth_of_cut", ""),
    ("fz f_z feed_per_tooth chip_load chipload feedrate feed_rate", "feed", "feed, with its unit: 0.1 mm/tooth"),
    ("fz f_z feed chip_load chipload", "feed_per_tooth", ""),
    ("n rpm speed spindle rotation_speed spindle_rpm", "spindle_speed", ""),
    ("fs rate sample_rate sampling_frequency sample_frequency", "sampling_rate", ""),
    ("teeth tooth_count number_of_teeth number_of_flutes nflutes z", "flutes", ""),
    ("helix lambda", "helix_angle", ""),
    ("d dia tool_diameter", "diameter", ""),
    ("kt ktc k_t k_tc specific_force specific_cutting_force ks k_s", "tangential_coefficient", ""),
    ("kn knc k_n krc k_rc radial_coefficient", "normal_coefficient", ""),
    ("kr k_r", "normal_coefficient", "normal_coefficient, a force per area; where yours is the ratio K_r, K_t times it"),
    ("m modal_mass", "mass", ""),
    ("k stiffness modal_stiffness", "stiffness", ""),
    ("k stiffness modal_stiffness", "mass", _STIFFNESS),
    ("f fn f_n frequency eigenfrequency resonance", "natural_frequency", ""),
    ("zeta xi damping", "damping_ratio", ""),
    ("milling mode_of_milling climb conventional", "direction", ""),
)
_VALUES = {"climb": "down-milling", "climb milling": "down-milling", "down": "down-milling", "down milling": "down-milling",
           "conventional": "up-milling", "conventional milling": "up-milling", "up": "up-milling", "up milling": "up-milling"}


def _folded(word: str) -> str:
    return word.strip().casefold().replace("-", "_").replace(" ", "_")


def meant(word: str, known: Iterable[str]) -> str | None:
    """What to write for a foreign word among the keys that are known in its place; None where it is not one, or is known."""
    keys, folded = set(known), _folded(word)
    if folded in keys:
        return None
    for words, key, more in _WORDS:
        if key in keys and folded in words.split():
            return more or key
    return None


def milling_direction(value: object) -> object:
    """up-milling or down-milling for the shop's words, climb and conventional; any other value as it is."""
    return _VALUES.get(" ".join(value.casefold().replace("-", " ").replace("_", " ").split()), value) \
        if isinstance(value, str) else value
