# SPDX-License-Identifier: Apache-2.0
"""Bearings from two places that stay where they are: the scenario of config/two_bearings.yaml."""

from pathlib import Path

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.analysis.bounds import posterior_cramer_rao
from kalman_ros.core import Space
from kalman_ros.estimators.consistency import chi_square_bounds
from kalman_ros.scenario.parameter_files import from_file
from kalman_ros.sensors.bearing import Bearing
from kalman_ros.simulation import closed_loop

CONFIG = Path(__file__).parents[2] / 'config' / 'two_bearings.yaml'
SECONDS, RUNS = 20.0, 20


def built(**options):
    return scenario.build({**from_file(CONFIG, 'plant'), **options})


def tracks(believed, filter, runs=RUNS):
    """Return the error of position (runs, N), and the NIS of all bearings."""
    errors, nis = [], []
    for seed in range(runs):
        run = closed_loop.run(believed, None, SECONDS, seed, filter=filter)
        errors.append(np.hypot(*(run.truth - run.estimate)[:, :2].T))
        nis += [found.nis for found in run.innovations.values()]
    return np.array(errors), np.concatenate(nis)


def test_a_bearing_is_seen_from_where_the_sensor_stands():
    plane = Space(('y', 'v', 'x'), ('m', 'm/s', 'm'))
    sensor = Bearing(plane, [0.1], ('x', 'y'), position=(10.0, -4.0))
    x = np.array([-1.0, 7.0, 7.0])
    np.testing.assert_allclose(sensor.measure(x), [np.arctan2(3.0, -3.0)])
    np.testing.assert_allclose(sensor.line_of_sight(x), [-3.0, 3.0])
    np.testing.assert_allclose(sensor.jacobian(x), [[-3.0 / 18.0, 0.0, -3.0 / 18.0]])
    with pytest.raises(ValueError, match='position: expected 2 numbers, got 3'):
        Bearing(plane, [0.1], position=(0.0, 0.0, 0.0))


def test_two_bearings_cross_at_the_target():
    both = built()
    x = both.initial_state
    west, east = (both.sensors[name].sensor for name in ('west', 'east'))
    lines = [np.array([np.cos(b), np.sin(b)]) for b in (west.measure(x)[0], east.measure(x)[0])]
    near, _ = np.linalg.solve(
        np.column_stack((lines[0], -lines[1])), np.array([20.0, 5.0]) - np.array([-20.0, 0.0])
    )
    np.testing.assert_allclose(np.array([-20.0, 0.0]) + near * lines[0], x[:2])


@pytest.mark.thorough
@pytest.mark.slow
def test_tracks_are_as_good_as_they_can_be():
    both = built()
    errors, nis = tracks(both, 'ukf')
    low, high = chi_square_bounds(1.0, 2.0 / len(nis), 1e-3)
    assert low < nis.mean() < high
    # along the path without noise, which the others do not leave by much
    x, path = both.initial_state, []
    for _ in range(errors.shape[1]):
        path.append(x)
        x = both.model.step(x, np.zeros(0), both.plan.dt)
    P = posterior_cramer_rao(both, np.array(path), np.zeros((len(path), 0)))
    bound = np.sqrt(np.trace(P[:, :2, :2], axis1=1, axis2=2))[100:].mean()
    assert 0.8 * bound < np.sqrt(np.mean(errors[:, 100:] ** 2)) < 1.25 * bound
    assert bound < 0.6


@pytest.mark.slow
def test_one_place_alone_does_not_tell_the_range():
    def spread(believed):
        P = closed_loop.run(believed, None, SECONDS, 0).covariance[-1, :2, :2]
        return np.sqrt(np.trace(P))

    assert spread(built(**{'east.enabled': False})) > 5.0 > 1.0 > spread(built())
