# SPDX-License-Identifier: Apache-2.0
"""The controller of a loop in this process: its references, and the inputs that follow."""

from dataclasses import replace

import numpy as np
import pytest

from kalman_ros.control.limiter import limits_of
from kalman_ros.control.motion import Motion
from kalman_ros.scenario import build
from kalman_ros.scenario import regulator as regulators
from kalman_ros.scenario.motions import with_law
from kalman_ros.simulation.loop_law import Law

MASS = build({'model': 'mass_spring_damper', 'law': 'mpc', 'horizon': 0.2})
POLE = build({'model': 'cart_pole', 'law': 'mpc', 'horizon': 0.2})


def law_of(scenario, reference, magnitude=np.inf, rate=np.inf):
    limits = limits_of(
        scenario.model.input.size, {'input_limit': magnitude, 'input_rate_limit': rate}
    )
    return Law(scenario, regulators.feedback(scenario), limits, reference)


def answer(scenario, reference, magnitude=np.inf, rate=np.inf):
    return law_of(scenario, reference, magnitude, rate)()


def at_rest(scenario, steps=10):
    """Return a motion that stays at the equilibrium, without gains and differences."""
    x, u = scenario.model.equilibrium
    count = (steps + 1, 1)
    return Motion(scenario.model.state, 1.0 / scenario.rate, np.tile(x, count), np.tile(u, count))


def test_a_motion_of_a_nonlinear_model_is_predicted_by_its_differences():
    """They are computed where the motion has none, and only for a law that predicts."""
    motion = at_rest(POLE)
    whole = with_law(POLE, motion)
    assert whole.differences is not None
    x = np.array([0.1, 0.0, 0.05, 0.0])
    u = answer(POLE, motion)(0, x)
    np.testing.assert_array_equal(u, answer(POLE, whole)(0, x))
    assert answer(POLE, motion)._fitting(motion).differences is not None
    assert answer(POLE, motion)._fitting(whole) is whole
    plain = build({'model': 'cart_pole'})
    assert answer(plain, motion)._fitting(motion) is motion
    motion = at_rest(MASS)
    assert answer(MASS, motion)._fitting(motion) is motion


@pytest.mark.parametrize('factor', [1.0, 1.0 + 0.9e-9, 1.0 + 1.1e-9, 1.0 - 1.1e-9, 2.0])
def test_a_motion_has_the_rate_of_the_loop(factor):
    motion = at_rest(MASS)
    other = replace(motion, dt=factor * motion.dt)
    if abs(factor - 1.0) < 1e-9:
        assert answer(MASS, other).target.shape == (2,)
    else:
        with pytest.raises(
            ValueError, match=r'^reference: expected a motion of \(x, v\) in steps'
        ):
            answer(MASS, other)


def test_a_motion_of_another_model_is_refused():
    with pytest.raises(ValueError, match=r'got one of \(x, v, theta, omega\) in steps of'):
        answer(build({'model': 'mass_spring_damper', 'rate': POLE.rate}), at_rest(POLE))


@pytest.mark.parametrize(
    ('reference', 'state'),
    [(None, [0.0, 0.0]), ([0.5, 0.0], [0.5, 0.0]), ({'x': 0.5}, [0.5, 0.0]), ({}, [0.0, 0.0])],
)
def test_a_reference_is_a_state_or_some_of_its_coordinates(reference, state):
    law = law_of(MASS, reference)
    np.testing.assert_array_equal(law.target(3.0), state)
    np.testing.assert_array_equal(law().target, state)
    later = replace(law, reference=lambda time: reference if time >= 3.0 else [0.1, 0.0])
    np.testing.assert_array_equal(later.target(3.0), state)
    np.testing.assert_array_equal(later.target(2.9), [0.1, 0.0])


def test_the_target_of_a_motion_is_its_state_at_that_time():
    motion = at_rest(MASS)
    states = np.linspace([0.0, 0.0], [1.0, 0.0], len(motion.states))
    law = law_of(MASS, replace(motion, states=states))
    np.testing.assert_allclose(law.target(3.0 * motion.dt), states[3])


def test_a_reference_that_no_input_holds_leaves_the_last_one():
    found = answer(MASS, {'x': 0.5})
    with pytest.raises(ValueError, match='reference'):
        found.hold({'v': 1.0})
    np.testing.assert_array_equal(found.target, [0.5, 0.0])
    found.follow(1.0)
    found.hold(None)
    np.testing.assert_array_equal(found.target, [0.0, 0.0])


def test_a_law_is_proportional_without_limit_reference_and_prediction():
    plain = build({'model': 'mass_spring_damper'})
    assert law_of(plain, None).proportional
    for law in (
        law_of(plain, None, magnitude=1.0), law_of(plain, None, rate=1.0),
        law_of(plain, [0.0, 0.0]), law_of(MASS, None),
    ):  # fmt: skip
        assert not law.proportional


def test_the_first_input_is_limited_as_after_one_step_and_later_ones_by_the_time_between():
    plain = build({'model': 'mass_spring_damper'})
    found, x, dt = answer(plain, None, rate=10.0), np.array([-100.0, 0.0]), 1.0 / plain.rate
    np.testing.assert_allclose(found(10**9, x), 10.0 * dt)
    np.testing.assert_allclose(found(10**9 + 300_000_000, x), 10.0 * (dt + 0.3))
    assert found.limited == 2
