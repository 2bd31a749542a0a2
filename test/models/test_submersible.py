# SPDX-License-Identifier: Apache-2.0
"""The submersible: its mechanics, what its sensors see, and what its cost asks for."""

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.analysis.observability import observability
from kalman_ros.core import Space
from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.models.submersible import Submersible
from kalman_ros.scenario.regulator import regulator
from kalman_ros.sensors.pressure import Pressure
from kalman_ros.simulation import closed_loop


@pytest.fixture(scope='module')
def built():
    return scenario.build({'model': 'submersible'})


def test_without_drag_it_keeps_its_energy():
    drags = ('linear_drag', 'quadratic_drag', 'angular_drag', 'quadratic_angular_drag')
    model = Submersible(**dict.fromkeys(drags, 0.0), buoyancy=5.0, righting_moment=10.0)

    def energy(x):
        _, z, pitch, u, w, q = x.T
        motion = 0.5 * (35.0 * u**2 + 55.0 * w**2 + 4.0 * q**2)
        return motion - 5.0 * z - 10.0 * np.cos(pitch)

    x = np.array([[0.0, -3.0, 0.8, 1.0, -0.5, 0.7], [0.0, 0.0, -2.0, -1.0, 0.3, 0.0]])
    before = energy(x)
    for _ in range(500):
        x = model.step(x, np.zeros(3), 0.02)
    np.testing.assert_allclose(energy(x), before, rtol=1e-5)


def test_drag_brakes_either_way():
    model = Submersible(buoyancy=0.0, righting_moment=0.0)
    for sign in (1.0, -1.0):
        x = np.array([0.0, 0.0, 0.0, sign, sign, sign])
        for axis in range(3):
            only = np.where(np.arange(6) == 3 + axis, x, 0.0)
            assert sign * model.derivative(only, np.zeros(3))[3 + axis] < 0.0


def test_depth_is_read_as_pressure():
    gauge = Pressure(Space(('x', 'z'), ('m', 'm')), [300.0], density=1000.0, gravity=10.0)
    x = np.array([[7.0, 0.0], [7.0, -2.0]])
    np.testing.assert_allclose(gauge.measure(x), [[101325.0], [121325.0]])


def test_the_sensors_do_not_tell_where_it_is_along_x(built):
    # nor the surge: it moves nothing that is read while it is level and still
    assert observability(built).unseen == ('x', 'u')


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize('filter', ['ekf', 'ukf'])
def test_upright_comes_first_and_depth_later(built, filter):
    run = closed_loop.run(built, regulator(built)[0].gain, 20.0, 0, filter=filter)
    _, z, pitch, *_ = run.truth.T
    assert np.abs(pitch[run.time > 1.0]).max() < 0.1 * abs(pitch[0])
    assert abs(z[run.time > 1.0][0]) > 0.9 * abs(z[0])
    assert np.abs(z[-100:]).max() < 0.15 * abs(z[0])
    # at rest the thrusters hold the buoyancy down
    np.testing.assert_allclose(run.input[-500:, 1:].sum(axis=1).mean(), -5.0, atol=2.0)
    for found in run.innovations.values():
        k = found.values.shape[1]
        low, high = chi_square_bounds(1.0, 2.0 / (k * len(found.nis)), 1e-3)
        assert low < found.nis.mean() / k < high
    error = built.model.state.subtract(run.truth, run.estimate)
    assert nees(error, run.covariance).mean() / 6 < 1.6
    # dead reckoning along x is not bounded, and says so
    spread = run.covariance[:, 0, 0]
    assert spread[-1] > spread[1000] > spread[100] > built.initial_belief.covariance[0, 0]
