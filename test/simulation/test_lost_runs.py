# SPDX-License-Identifier: Apache-2.0
"""A run is lost beyond ten times its start, or beyond the errors that are given, by state."""

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.simulation.lost_runs import allowed, lost_runs
from kalman_ros.simulation.run_statistics import Outcomes

SCENARIO = scenario.build(
    {'model': 'mass_spring_damper', 'initial_state': [2.0, 0.0], 'initial_std': [0.5, 0.25]}
)
LITTLE = 1.0 + 1e-12
TARGET = np.zeros(2)


def ended(error=(0.0, 0.0), std=(0.0, 0.0), state=(0.0, 0.0), nees=1.0, squared_error=(0.0, 0.0)):
    """Return the outcomes of one run."""
    none = np.zeros((1, 2))
    return Outcomes(
        np.array([squared_error]), np.array([nees]), {}, np.zeros(1), np.zeros(1),
        np.array([error]), np.array([std]), np.array([state]),
        np.ones(1, dtype=int), none, none, np.zeros(1),
    )  # fmt: skip


def is_lost(outcomes, target=None, most=None):
    (lost,) = lost_runs(SCENARIO, outcomes, target, most)
    return bool(lost)


def test_the_errors_given_are_by_the_names_of_states():
    assert allowed(SCENARIO, None) is None
    assert allowed(SCENARIO, {}).tolist() == [np.inf, np.inf]
    second = SCENARIO.model.state.names[1]
    assert allowed(SCENARIO, {second: 3}).tolist() == [np.inf, 3.0]


@pytest.mark.parametrize(
    ('given', 'says'),
    [
        (3.0, 'expected errors by the name of a state, got 3.0'),
        ({'w': 1.0}, "got 'w'"),
        ({'x': 0.0}, 'expected a positive error of x, got 0.0'),
        ({'x': np.nan}, 'expected a positive error of x, got nan'),
        ({'x': 'a'}, "expected a positive error of x, got 'a'"),
    ],
)
def test_what_is_no_error_of_a_state_is_refused(given, says):
    with pytest.raises(ValueError, match=f'^lost: .*{says}'):
        allowed(SCENARIO, given)


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_an_error_may_be_ten_deviations_of_the_start_or_of_those_claimed(sign):
    for std, most in (((0.0, 0.0), [5.0, 2.5]), ((1.0, 0.1), [10.0, 2.5])):
        for index in range(2):
            error = np.zeros(2)
            error[index] = sign * most[index]
            assert not is_lost(ended(error, std))
            assert is_lost(ended(error * LITTLE, std))


def test_a_state_may_be_ten_times_as_far_from_its_target_as_at_the_start():
    for index, most in enumerate((20.0, 2.5)):
        state = np.zeros(2)
        state[index] = -most
        assert not is_lost(ended(state=state), TARGET)
        assert is_lost(ended(state=state * LITTLE), TARGET)
        assert not is_lost(ended(state=state * LITTLE))  # nothing holds it there


def test_the_errors_given_replace_those_of_the_start():
    most = np.array([1.0, np.inf])
    assert not is_lost(ended(error=(1.0, 1e9), state=(-1.0, 1e9)), TARGET, most)
    assert is_lost(ended(error=(LITTLE, 0.0)), TARGET, most)
    assert is_lost(ended(state=(-LITTLE, 0.0)), TARGET, most)


@pytest.mark.parametrize('value', [np.nan, np.inf])
@pytest.mark.parametrize('what', ['nees', 'squared_error', 'error', 'state'])
def test_a_run_that_is_not_finite_is_lost(what, value):
    broken = value if what == 'nees' else (0.0, value)
    assert is_lost(ended(**{what: broken}), TARGET)
