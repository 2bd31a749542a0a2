# SPDX-License-Identifier: Apache-2.0
"""From no start within the region of a design does a limit act; just outside one does."""

from __future__ import annotations

import numpy as np
import pytest
from thorough import mostly_thorough

from kalman_ros.analysis.unlimited import unlimited_starts
from kalman_ros.control.limiter import Limits, limits_of
from kalman_ros.core import Array
from kalman_ros.scenario import Scenario, build
from kalman_ros.scenario.regulator import feedback

CASES = {
    'input': ({'model': 'cart_pole'}, {'input_limit': 10.0}),
    'sides': ({'model': 'cart_pole'}, {'input_limit': 10.0, 'input_lower_limit': -3.0}),
    'rate': ({'model': 'cart_pole'}, {'input_rate_limit': 200.0}),
    'states': (
        {'model': 'cart_pole', 'law': 'mpc', 'state_limit.x': [-0.5, 1.0]},
        {'input_limit': 50.0},
    ),
    'two inputs': (
        {'model': 'mass_spring_damper_2d'}, {'input_limit': [1.0, 0.5]},
    ),
    'integrals': (
        {'model': 'mass_spring_damper', 'law': 'lqi', 'tracked': ['x']},
        {'input_limit': 2.0},
    ),
}  # fmt: skip


def acts(scenario: Scenario, limits: Limits, start: Array) -> bool:
    """Simulate the loop step by step and return whether a limit would act."""
    dt, law = 1.0 / scenario.rate, feedback(scenario)
    step, regulator = scenario.model.transition(*scenario.model.equilibrium, dt), law.system(dt)
    x, q, before = start, np.zeros(len(regulator.A)), np.zeros(step.G.shape[1])
    for _ in range(3000):
        u = -(regulator.C @ q + regulator.D @ x)
        if np.any(u != limits.within(u)) or np.any(np.abs(u - before) > limits.rate * dt):
            return True
        if law.prediction is not None and (
            np.any(x > law.prediction.high) or np.any(x < law.prediction.low)
        ):
            return True
        q, x, before = regulator.A @ q + regulator.B @ x, step.F @ x + step.G @ u, u
        if max(np.abs(x).max(), np.abs(q).max(initial=0.0), np.abs(u).max()) < 1e-6:
            break  # it comes to rest
    return False


@pytest.mark.slow
@pytest.mark.parametrize('name', mostly_thorough(CASES, 'sides'))
def test_limits_act_only_outside_the_region(name: str) -> None:
    values, given = CASES[name]
    scenario = build(values)
    limits = limits_of(scenario.model.input.size, given)
    region = unlimited_starts(scenario, feedback(scenario), limits)
    n = len(region)
    assert np.isfinite(region).all()
    corners = np.concatenate((np.diag(-region[:, 0]), np.diag(region[:, 1])))
    for corner in corners:
        assert acts(scenario, limits, 1.001 * corner)
        assert not acts(scenario, limits, 0.999 * corner)
    shares = np.random.default_rng(0).dirichlet(np.ones(2 * n) * 0.3, 30)
    assert not any(acts(scenario, limits, 0.999 * share @ corners) for share in shares)


def test_without_limits_there_is_no_end() -> None:
    scenario = build({'model': 'cart_pole'})
    region = unlimited_starts(scenario, feedback(scenario), Limits.none(1))
    assert np.isinf(region).all()


def test_no_start_is_free_where_the_rest_itself_exceeds_a_limit() -> None:
    scenario = build({'model': 'mass_spring_damper', 'law': 'mpc', 'state_limit.x': [0.5, 1.0]})
    starts = unlimited_starts(scenario, feedback(scenario), Limits.none(1))
    assert not starts.any()
