# SPDX-License-Identifier: Apache-2.0
"""Second-order terms of readings within a belief."""

import numpy as np
import pytest

from kalman_ros.analysis.curvature import curved, second_order
from kalman_ros.core import Gaussian, Space
from kalman_ros.estimators import FILTERS, filter_class
from kalman_ros.scenario import build
from kalman_ros.sensors.radar import Radar

RADAR = {
    'model': 'diff_drive', 'filter': 'ekf', 'sensors': ['radar'], 'radar.kind': 'radar',
    'radar.measures': ['x', 'y', 'v', 'psi'], 'radar.noise': [0.05, 0.01, 0.3],
    'radar.topic': 'radar', 'radar.type': 'geometry_msgs/Vector3Stamped',
    'radar.fields': ['vector.x', 'vector.y', 'vector.z'], 'radar.rate': 10.0,
    'initial_state': [5.0, 3.0, 0.5, 0.0, 0.1], 'initial_estimate': [5.0, 3.0, 0.5, 0.0, 0.1],
    'initial_std': [2.0, 2.0, 0.5, 0.2, 0.2],
}  # fmt: skip
PLANE = Space(('x', 'y'), ('m', 'm'))


class Product:
    """A sensor that reads x y and x^2."""

    output = Space(('product', 'square'), ('', ''))

    @staticmethod
    def measure(x):
        return np.stack([x[..., 0] * x[..., 1], x[..., 0] ** 2], axis=-1)


def test_of_polynomials_it_is_that_of_draws():
    P = np.array([[0.5, 0.2], [0.2, 0.3]])
    belief = Gaussian(np.array([2.0, -1.0]), P)
    found = second_order(Product(), PLANE, belief)
    z = np.random.default_rng(0).multivariate_normal(np.zeros(2), P, 400_000)
    drawn = np.stack([z[:, 0] * z[:, 1], z[:, 0] ** 2], axis=1).std(axis=0)
    np.testing.assert_allclose(found, drawn, rtol=0.01)


@pytest.mark.parametrize(('std', 'warned'), [(2.0, True), (0.02, False)])
def test_a_radar_is_curved_within_a_wide_belief(std, warned):
    scenario = build({**RADAR, 'initial_std': [std, std, 0.5, 0.2, 0.2]}, with_law=False)
    said = list(curved(scenario))
    assert bool(said) is warned
    if warned:
        assert 'radar is not linear: its second-order term of' in said[0]
        assert 'iterated_ekf and ukf are not' in said[0]


@pytest.mark.parametrize('name', FILTERS)
def test_only_filters_that_linearise_once_are_warned(name):
    once = {'kf', 'ekf', 'square_root'}
    assert filter_class(name).linearises_once is (name in once)


def test_a_straight_sensor_has_none():
    scenario = build(RADAR, with_law=False)
    sensor = scenario.sensors['radar'].sensor
    assert isinstance(sensor, Radar)
    certain = Gaussian(scenario.initial_belief.mean, np.zeros((5, 5)))
    np.testing.assert_array_equal(second_order(sensor, scenario.model.state, certain), 0.0)


def test_a_sensor_that_fails_elsewhere_is_not_judged(monkeypatch):
    scenario = build(RADAR, with_law=False)

    def fail(sensor, x):
        raise ValueError('x is no such place')

    monkeypatch.setattr(Radar, 'measure', fail)
    assert list(curved(scenario)) == []


def test_an_unknown_first_state_is_not_judged():
    scenario = build({**RADAR, 'initial_std': [np.inf, 2.0, 0.5, 0.2, 0.2]}, with_law=False)
    assert list(curved(scenario)) == []
