# SPDX-License-Identifier: Apache-2.0
"""The calls that the exported C is checked with: what goes wrong in them, and when."""

from collections import Counter

import numpy as np
import pytest

pytest.importorskip('casadi')
from kalman_ros import scenario
from kalman_ros.embedded.loop import loop
from kalman_ros.embedded.vectors import OUTCOMES, Calls, recorded
from kalman_ros.estimators.outcome import Outcome

GATED = {'model': 'mass_spring_damper', 'position.gate': 0.99, 'velocity.gate': 0.99}


@pytest.fixture(scope='module')
def exported():
    return loop(scenario.build(GATED))


@pytest.fixture(scope='module')
def calls(exported):
    return [*recorded(exported, 120)]


def test_a_hostile_run_has_steps_back_and_idle_ones(exported, calls):
    kinds = Counter(call.kind for call in calls)
    back = [call for call in calls if call.kind == 'P' and call.given[0] < 0.0]
    assert [call.outcome for call in back] == [9, 9]  # at steps 11 and 108
    assert kinds['P'] == 119 + 2
    assert (kinds['O'], kinds['U']) == (4, 116)
    steps = np.cumsum([call.kind == 'P' and call.given[0] > 0.0 for call in calls])
    where = [step for step, call in zip(steps, calls) if call.kind == 'O']
    assert where == [80, 81, 82, 83]
    where = [s for s, call in zip(steps, calls) if call.kind == 'P' and call.given[0] < 0.0]
    assert where == [10, 107]


def test_a_hostile_run_has_readings_of_all_kinds(calls):
    outcomes = Counter(call.outcome for call in calls if call.kind == 'C')
    expected = (Outcome.FUSED, Outcome.REJECTED, Outcome.NOT_FINITE, Outcome.BAD_COVARIANCE,
                Outcome.DUPLICATE)  # fmt: skip
    assert all(outcomes[OUTCOMES[outcome]] > 0 for outcome in expected)
    sizes = Counter((call.sensor, call.given.size) for call in calls if call.kind == 'C')
    assert sizes[1, 2] == 2  # the velocity with a covariance, of which one is negative
    nans = [call for call in calls if call.kind == 'C' and np.isnan(call.given).any()]
    assert len(nans) >= 1


def test_a_run_that_is_not_hostile_has_none(exported):
    calls = [*recorded(exported, 160, hostile=False)]
    kinds = Counter(call.kind for call in calls)
    assert (kinds['P'], kinds['U'], kinds['O'], kinds['H']) == (159, 160, 0, 1)
    outcomes = Counter(call.outcome for call in calls if call.kind != 'H')
    good = OUTCOMES[Outcome.FUSED], OUTCOMES[Outcome.REJECTED]
    assert set(outcomes) <= {0, *good}


@pytest.mark.parametrize(('dt', 'outcome'), [(0.0, 0), (-1e-9, 9), (1e9, 9), (np.nan, 9)])
def test_time_passes_forward(exported, dt, outcome):
    assert Calls(exported).predict(dt).outcome == outcome


def test_what_is_not_finite_is_neither_an_input_nor_a_state_to_hold(exported):
    calls, bad = Calls(exported), OUTCOMES[Outcome.NOT_FINITE]
    assert calls.input(np.array([np.nan])).outcome == bad
    assert calls.hold(np.array([0.0, np.inf])).outcome == bad
    assert calls.hold(np.array([0.1, 1.0])).outcome == 10  # at a place with a speed
    assert calls.hold(np.array([0.1, 0.0])).outcome == 0
    pushed = calls.input(np.array([0.7]))
    assert (pushed.outcome, pushed.input.tolist()) == (0, [0.7])
