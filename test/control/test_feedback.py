# SPDX-License-Identifier: Apache-2.0
"""A state feedback at work: what it tracks, how it keeps its limits, and that it never jumps."""

import numpy as np
import pytest

from kalman_ros.control.feedback import Feedback, Regulator
from kalman_ros.control.laws import LAWS, build_law, law_options
from kalman_ros.control.limiter import Limiter, Limits, limits_of
from kalman_ros.control.lqr import cost
from kalman_ros.control.tracking import feed_forward, holdable
from kalman_ros.core import DesignError, LinearSystem, Space

DT = 0.01
SYSTEM = LinearSystem(
    [[0.0, 1.0], [-1.0, -0.2]],
    [[0.0], [1.0]],
    np.zeros((2, 2)),
    Space(('x', 'v'), ('m', 'm/s')),
    Space(('f',), ('N',)),
)
WEIGHTS = cost([10.0, 1.0], [0.5], (2, 1))
REST = np.zeros(2), np.zeros(1)


def law(name='lqr', weights=WEIGHTS, **options):
    return build_law(name, SYSTEM, weights, DT, options)


class Loop:
    """A regulator whose input is limited."""

    def __init__(self, regulator, limits):
        self.regulator, self.limiter = regulator, Limiter(limits, np.zeros(len(limits.rate)))

    def answer(self, x, dt):
        wanted = self.regulator.propose(x, dt)
        u = self.limiter.toward(wanted, dt)
        self.regulator.applied(x, wanted, u, dt)
        return u


def regulator(name='lqr', limits=None, blend=0.0, **options):
    found = Regulator(SYSTEM.state, law(name, **options), REST, blend)
    return Loop(found, limits or Limits.none(1))


def simulate(regulator, seconds, x=(0.0, 0.0), disturbance=0.0):
    """Return states and inputs (N, n), (N, m) under an unknown constant force."""
    step, x = SYSTEM.sampled(DT), np.array(x)
    states, inputs = [], []
    for _ in range(round(seconds / DT)):
        u = regulator.answer(x, DT)
        states.append(x)
        inputs.append(u)
        x = step.F @ x + step.G @ (u + disturbance)
    return np.array(states), np.array(inputs)


def test_lqr_and_placement_are_their_gains():
    found = law()
    x = np.array([0.3, -0.2])
    np.testing.assert_allclose(regulator().answer(x, DT), -found.gain @ x)
    placed = law('placement', regulator_poles=[-3.0, -3.0], regulator_frequencies=[2.0, -2.0])
    wanted = np.exp(np.array([-3.0 + 2.0j, -3.0 - 2.0j]) * DT)
    np.testing.assert_allclose(np.sort_complex(placed.poles), np.sort_complex(wanted), atol=1e-9)


def test_a_reference_is_held_by_the_input_that_it_needs():
    held = regulator()
    found = feed_forward(SYSTEM).equilibrium([2.0, 0.0])
    held.regulator.hold(found.state, found.input)
    states, inputs = simulate(held, 15.0)
    np.testing.assert_allclose(states[-1], [2.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(inputs[-1], 2.0, atol=1e-6)


def test_only_integral_action_leaves_no_error_under_an_unknown_force():
    plain, _ = simulate(regulator(), 30.0, disturbance=3.0)
    integral, _ = simulate(regulator('lqi'), 30.0, disturbance=3.0)
    assert plain[-1, 0] > 0.3
    assert abs(integral[-1, 0]) < 1e-3


def test_no_input_exceeds_its_limits_and_the_integral_does_not_wind_up():
    limits = limits_of(1, {'input_limit': 2.0})
    held = regulator('lqi', limits)
    held.regulator.hold(*(np.array([1.9, 0.0]), np.zeros(1)))
    states, inputs = simulate(held, 40.0)
    assert np.abs(inputs).max() <= 2.0
    assert held.limiter.limited > 50
    assert abs(states[-1, 0] - 1.9) < 1e-3
    assert states[:, 0].max() < 2.0  # 2.11 where the integral winds up


def test_the_input_changes_no_faster_than_its_limit():
    held = regulator(limits=limits_of(1, {'input_rate_limit': 5.0}))
    held.answer(np.zeros(2), DT)
    _, inputs = simulate(held, 5.0, x=(1.0, 0.0))
    assert np.abs(np.diff(inputs[:, 0])).max() <= 5.0 * DT + 1e-12
    assert abs(inputs[-1, 0]) < 0.2


@pytest.mark.parametrize('name', ['lqr', 'lqi'])
def test_other_gains_come_without_a_bump_and_stay(name):
    held = regulator(name, blend=0.3)
    states, inputs = simulate(held, 0.5, x=(1.0, 0.0))
    stiff = law(name, cost([1e4, 1.0], [0.1], (2, 1)))
    x = states[-1]
    assert abs(-stiff.gain @ x - inputs[-1])[0] > 10.0
    held.regulator.adopt(stiff, 0.3)
    np.testing.assert_allclose(held.answer(x, 0.0), inputs[-1], atol=1e-12)
    for _ in range(1000):
        u = held.answer(np.array([0.0, 0.1]), DT)
    if name == 'lqr':
        np.testing.assert_allclose(u, -stiff.gain @ [0.0, 0.1], atol=1e-9)


def test_errors_of_angles_are_the_short_way_round():
    space = Space(('a',), ('rad',), angles=('a',))
    gains = Feedback(np.array([[1.0]]), np.empty((1, 0)), (), np.array([0.9]))
    held = Regulator(space, gains, (np.array([3.1]), np.zeros(1)))
    np.testing.assert_allclose(held.propose(np.array([-3.1]), DT), 6.2 - 2.0 * np.pi)


def test_what_steady_inputs_can_hold():
    assert holdable(SYSTEM) == ['x']
    free = LinearSystem([[0.0]], [[1.0]], [[0.0]], Space(('x',), ('m',)), Space(('v',), ('m/s',)))
    assert holdable(free) == ['x']


def test_every_law_has_options_that_explain_themselves():
    for name in LAWS:
        assert all(len(option.description) > 10 for option in law_options(name))
    with pytest.raises(ValueError, match="unknown law 'lqg'"):
        law('lqg')
    with pytest.raises(DesignError, match='tracked'):
        law('lqi', tracked=['v'])
    with pytest.raises(ValueError, match='regulator_poles'):
        law('placement', regulator_poles=[1.0])
