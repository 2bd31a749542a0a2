# SPDX-License-Identifier: Apache-2.0
"""Targets without an input or a controller, with unsynchronised readings."""

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.core import DesignError, Space
from kalman_ros.estimators.consistency import nees
from kalman_ros.models.turn_rate import TurnRate
from kalman_ros.scenario.regulator import price, regulator
from kalman_ros.sensors.radar import Radar
from kalman_ros.simulation import closed_loop

NOISE = (0.3, 0.03, 0.3)


def test_a_constant_turn_is_a_circle():
    model, v, omega = TurnRate(), 3.0, 0.4
    x = np.array([0.0, 0.0, v, 3.0, omega])
    for _ in range(100):
        x = model.step(x, np.zeros(0), 0.1)
    r, psi = v / omega, 3.0 + 10.0 * omega
    expected = [r * (np.sin(psi) - np.sin(3.0)), r * (np.cos(3.0) - np.cos(psi)), v]
    np.testing.assert_allclose(x[:3], expected, atol=1e-6)
    np.testing.assert_allclose(np.exp(1j * x[3]), np.exp(1j * psi))


def test_a_radar_reads_the_same_from_either_kind_of_velocity():
    axes = Space(('v_y', 'v_x', 'y', 'x'), ('',) * 4)
    heading = Space(('psi', 'x', 'v', 'y'), ('',) * 4, angles=('psi',))
    one = Radar(axes, NOISE, ('x', 'y', 'v_x', 'v_y'))
    other = Radar(heading, NOISE, ('x', 'y', 'v', 'psi'))
    x, y, v, psi = 3.0, -4.0, 2.0, 2.5
    seen = one.measure(np.array([v * np.sin(psi), v * np.cos(psi), y, x]))
    np.testing.assert_allclose(seen, other.measure(np.array([psi, x, v, y])))
    rate = (x * v * np.cos(psi) + y * v * np.sin(psi)) / 5.0
    np.testing.assert_allclose(seen, [5.0, np.arctan2(y, x), rate])


def test_a_radar_needs_position_and_velocity():
    with pytest.raises(ValueError, match='measures: expected 4 names, got 2'):
        Radar(TurnRate.state, NOISE, ('x', 'y'))


@pytest.mark.thorough
@pytest.mark.parametrize(
    'name', ['constant_velocity', pytest.param('turn_rate', marks=pytest.mark.slow)]
)
@pytest.mark.parametrize('filter', ['ekf', 'ukf'])
def test_readings_that_do_not_wait_for_each_other(name, filter):
    built = scenario.build({'model': name})
    errors, spreads, nis = [], [], []
    for seed in range(4):
        run = closed_loop.run(built, None, 10.0, seed, filter=filter)
        lidar, radar = (run.readings[sensor].time for sensor in ('lidar', 'radar'))
        assert (len(lidar), len(radar)) == (101, 71)
        assert len(np.intersect1d(lidar, radar)) < 20
        settled = slice(100, None)
        errors.append(built.model.state.subtract(run.truth, run.estimate)[settled])
        spreads.append(run.covariance[settled])
        nis += [found.nis / found.values.shape[1] for found in run.innovations.values()]
    n = built.model.state.size
    assert 0.7 < nees(np.concatenate(errors), np.concatenate(spreads)).mean() / n < 1.4
    assert 0.85 < np.concatenate(nis).mean() < 1.15


def test_what_has_no_input_is_not_controlled():
    built = scenario.build({'model': 'turn_rate'})
    with pytest.raises(DesignError, match='model: it has no input'):
        regulator(built)
    assert not price(built).weight.any()


def test_an_input_cost_without_an_input_is_unknown():
    assert 'input_cost' not in scenario.options({'model': 'turn_rate'})
