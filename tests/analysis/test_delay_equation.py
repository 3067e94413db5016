"""The statement of the problem: coefficients against their integrals, geometry, refusals."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from testbed.analysis.linear.collocation import collocation_multipliers
from testbed.analysis.linear.delay_equation import DelayEquation, mathieu_equation, milling_equation
from testbed.cut import Cut
from testbed.machine import Cutter, Cutting, Model, Structure


def machine(**changes):
    cutter = Cutter(changes.pop("flutes", 1), 19.05e-3, changes.pop("helix_angle", 0.0))
    return Model(Structure(2.573, 146.6, 0.0032), cutter, Cutting(**changes))


def by_quadrature(model, cut, time):
    """b K_s(t) as the sum over teeth of the integral over height of the local directional coefficient."""
    cutting, cutter = model.cutting, model.cutter
    total = 0.0
    for tooth in range(4 * cutter.flutes):
        turned = cut.spindle_speed * time + tooth * cutter.pitch

        def local(z, turned=turned):
            angle = turned - 2 * z * math.tan(cutter.helix_angle) / cutter.diameter
            theta = cutting.entry_angle + angle
            force = (cutting.tangential_coefficient * math.cos(theta)
                     + cutting.normal_coefficient * math.sin(theta)) * math.sin(theta)
            return force if 0 <= angle < cutting.engagement_angle else 0.0

        slope = 2 * math.tan(cutter.helix_angle) / cutter.diameter
        depth = cut.axial_depth_of_cut
        corners = [] if slope == 0 else [z for z in (turned / slope, (turned - cutting.engagement_angle) / slope)
                                         if 0 < z < depth]
        total += quad(local, 0, depth, points=corners or None, epsabs=0, epsrel=1e-9, limit=200)[0]
    return total / model.structure.mass


@pytest.mark.parametrize("direction", ["up-milling", "down-milling"])
@pytest.mark.parametrize(("flutes", "helix", "immersion"), [(1, 0, 0.162), (2, 0.6, 0.2), (4, 0.5, 0.35), (3, 0, 0.5)])
def test_stiffness_is_the_integral_over_engaged_teeth_and_height(direction, flutes, helix, immersion):
    model = machine(flutes=flutes, helix_angle=helix, direction=direction, immersion=immersion)
    cut = Cut(400.0, 4e-3)
    equation = milling_equation(model, cut)
    times = np.random.default_rng(1).uniform(0, equation.delay, 12)
    expected = np.array([by_quadrature(model, cut, time) for time in times])
    assert np.abs(expected).max() > 1e3
    np.testing.assert_allclose(equation.periodic_stiffness(times), expected, rtol=1e-6,
                               atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(equation.forcing(times), cut.feed_per_tooth * equation.delayed(times))


def test_coefficients_are_smooth_between_breaks_and_vanish_after_the_cut():
    equation = milling_equation(machine(flutes=2, helix_angle=0.6, immersion=0.3), Cut(400.0, 4e-3))
    assert len(equation.breaks) > 2
    for low, high in zip(equation.breaks, equation.breaks[1:], strict=False):
        times = np.linspace(low, high, 203)[1:-1]
        values = equation.delayed(times)
        fitted = np.polynomial.Chebyshev.fit(times, values, 12)(times)
        assert np.abs(values - fitted).max() < 1e-7 * np.abs(values).max()


def test_cut_fills_the_period_when_teeth_overlap_and_leaves_free_flight_when_not():
    assert milling_equation(machine(flutes=4, immersion=0.3), Cut(400.0, 1e-3)).free_flight == 0.0
    equation = milling_equation(machine(), Cut(400.0, 1e-3))
    assert equation.free_flight == pytest.approx((1 - 0.162) * equation.delay, rel=1e-12)


def test_one_flute_of_low_immersion_is_the_papers_equation():
    model, cut = machine(), Cut(3810 * 2 * math.pi / 60, 2.9e-3)
    equation = milling_equation(model, cut)
    time = 0.1 * equation.delay
    theta = 2 * math.pi * 0.1
    expected = 2.9e-3 * (5.5e8 * math.cos(theta) + 2e8 * math.sin(theta)) * math.sin(theta) / 2.573
    assert equation.delayed(np.array([time]))[0] == pytest.approx(expected, rel=1e-12)
    assert equation.damping == pytest.approx(2 * 0.0032 * 2 * math.pi * 146.6)


def test_added_damping_moves_the_multipliers_towards_zero():
    model, cut = machine(), Cut(3635 * 2 * math.pi / 60, 2e-3)
    plain = collocation_multipliers(milling_equation(model, cut))[0]
    damped = collocation_multipliers(milling_equation(model, cut, added_damping=lambda t: 60.0 + 0 * t))[0]
    assert abs(damped) < abs(plain) - 0.01


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="no cutter"):
        milling_equation(Model(Structure(1.0, 100.0, 0.01)), Cut(400.0, 1e-3))
    with pytest.raises(ValueError, match="delay"):
        mathieu_equation(0.2, 1.0, 1.0, -0.2, tau=0.0)
    with pytest.raises(ValueError, match="breaks"):
        DelayEquation(0.0, 1.0, 1.0, (0.0, 0.5, 0.5))
    with pytest.raises(ValueError, match="outlast"):
        DelayEquation(0.0, 1.0, 1.0, (0.0, 1.5))
