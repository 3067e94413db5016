"""The measured hammer test against the frequency response measured at the same point."""

from __future__ import annotations

import math

import numpy as np

from testbed.analysis.multipliers.ring_down import fit_receptance, receptance
from tests.support.real_data import MEASUREMENTS
from tests.validation.claims import Claim, Section

BANDS = ((1000, 1140), (900, 1300))  # Hz, a narrow and a wide one


def check() -> Section:
    """The section of the table; the claims are not checked where the measurements are absent."""
    title, what = "Measured hammer test", "first mode: about 1067 Hz, damping ratio about 0.033"
    folder = MEASUREMENTS / "tap_test"
    if not folder.is_dir():
        return Section(title, (Claim(what, "within 0.5 % and 10 %", "-", None,
                                     "no measurements here: set TESTBED_MEASUREMENTS"),))
    time, force, acceleration = np.loadtxt(folder / "impact_Point1_time.txt").T
    blow = fit_receptance(*receptance(force, acceleration, 1.0 / float(np.mean(np.diff(time)))))
    frequency, real, imaginary = np.loadtxt(folder / "FRF_Point_1.txt").T[-3:]
    response = fit_receptance(frequency, real + 1j * imaginary, blow.band)
    far, damp = abs(blow.natural_frequency - 1067.0) / 1067.0, abs(blow.damping_ratio - 0.033) / 0.033
    apart = abs(blow.natural_frequency - response.natural_frequency)
    ratio = abs(blow.damping_ratio / response.damping_ratio - 1.0)
    bands = [fit_receptance(frequency, real + 1j * imaginary, band).damping_ratio for band in BANDS]
    note = (f"off by {blow.natural_frequency - 1067:+.1f} Hz and {100 * (blow.damping_ratio / 0.033 - 1):+.1f} %: one mode "
            f"with residual terms does not describe the resonance fully (misfit {100 * blow.misfit:.1f} %), so the damping "
            f"depends on the band: {bands[0]:.4f} from {BANDS[0][0]} to {BANDS[0][1]} Hz, {bands[1]:.4f} from "
            f"{BANDS[1][0]} to {BANDS[1][1]} Hz")
    return Section(title, (
        Claim(what, "within 0.5 % and 10 %", f"{blow.natural_frequency:.1f} Hz, {blow.damping_ratio:.4f}",
              far <= 0.005 and damp <= 0.1, note),
        Claim("time file against response file: frequency", "<= 1 Hz", f"{apart:.2f} Hz", apart <= 1.0),
        Claim("time file against response file: damping ratio", "<= 2 %", f"{100 * ratio:.2f} %", ratio <= 0.02),
        Claim("time file against response file: modal mass", "<= 3 %",
              f"{100 * abs(blow.modal_mass / response.modal_mass - 1):.2f} %",
              math.isclose(blow.modal_mass, response.modal_mass, rel_tol=0.03)),
    ))
