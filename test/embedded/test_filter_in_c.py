# SPDX-License-Identifier: Apache-2.0
"""``arithmetic: c``: the exported filter in the place of Python's, in node and replay."""

import numpy as np
import pytest
from thorough import mostly_thorough

from kalman_ros.core import Definite, Gaussian
from kalman_ros.estimators.filter import SmoothableFilter
from kalman_ros.pipeline.settings import settings
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file

pytest.importorskip('casadi')
from exported import needs_a_compiler

pytestmark = [pytest.mark.slow, needs_a_compiler]
MIXTURES = ('bearing_tracker', 'sound_tracker', 'two_bearings')
SUPPORTED = [name for name in shipped.names() if name not in MIXTURES]


@pytest.fixture(autouse=True)
def _exact_derivatives(monkeypatch):
    monkeypatch.setenv('KALMAN_ROS_ARITHMETIC', 'compiled')


def estimation(name, **values):
    return settings({**from_file(shipped.file(name), 'estimator'), **values}).fusion(wait=True)


@pytest.mark.parametrize('filter', ['kf', 'ekf', 'ukf', 'steady_state', 'luenberger'])
def test_a_step_is_that_of_the_filter_in_python(filter):
    python = estimation('mass_spring_damper', filter=filter)
    c = estimation('mass_spring_damper', filter=filter, arithmetic='c')
    assert c.arithmetic == 'c'
    assert isinstance(c.filter, SmoothableFilter) == isinstance(python.filter, SmoothableFilter)
    belief, u = python.initial, np.array([0.7])
    for sensor in python.sensors.values():
        sensor = sensor.with_covariance(3.0 * sensor.covariance)
        expected, found = (each.filter.predict(belief, u, 0.013) for each in (python, c))
        np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-13, atol=1e-15)
        np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-13, atol=1e-15)
        corrected = [
            each.filter.correct(expected, np.array([0.3]), sensor) for each in (python, c)
        ]
        for name in ('innovation', 'innovation_covariance', 'nis'):
            values = [getattr(each, name) for each in corrected]
            np.testing.assert_allclose(values[1], values[0], rtol=1e-12)
        belief = corrected[0].posterior
        np.testing.assert_allclose(corrected[1].posterior.mean, belief.mean, rtol=1e-12)


def test_readings_are_weighed_as_in_python():
    """The noise of each reading is another."""
    values = {'joint_states.adapt': True, 'joint_states.soft_gate': 0.8}
    found, noise = [], []
    for arithmetic in ('compiled', 'c'):
        online = estimation('cart_pole', arithmetic=arithmetic, **values).online(np.zeros(1))
        rng = np.random.default_rng(3)
        for step in range(15):  # fewer than for a recovery
            online.add_reading('joint_states', 10_000_000 * step, 0.1 * rng.standard_normal(2))
        found.append(online.belief.mean)
        noise.append(online.noise['joint_states'])
    assert noise[0] != 1.0
    assert noise[1] == pytest.approx(noise[0], rel=1e-9)
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9)


def test_what_rounding_may_make_indefinite_is_looked_at_by_python():
    c = estimation('cart_pole', arithmetic='c')
    sensor, u = c.sensors['joint_states'], np.zeros(1)
    good = c.filter.predict(c.initial, u, 0.01)
    flat = Gaussian(good.mean, np.full((4, 4), 1e12))  # of rank 1
    for belief, kind in ((good, Definite), (flat, Gaussian)):
        assert type(c.filter.correct(belief, np.zeros(2), sensor).posterior) is kind
        assert type(c.filter.predict(belief, u, 1e-6)) is kind


def test_what_has_no_result_fails_as_in_python():
    c = estimation('cart_pole', arithmetic='c')
    sensor = c.sensors['joint_states']
    lost = Gaussian(c.initial.mean, np.full((4, 4), np.nan))
    with pytest.raises(np.linalg.LinAlgError):
        c.filter.correct(lost, np.zeros(2), sensor)
    with pytest.raises(np.linalg.LinAlgError):
        c.filter.predict(Gaussian(np.full(4, 1e200), c.initial.covariance), np.zeros(1), 0.01)


@pytest.mark.parametrize(
    ('name', 'values', 'says'),
    [
        ('sound_tracker', {}, 'arithmetic: c is not possible here: filter: expected kf, ekf, ukf'),
        ('cart_pole', {'implementation': 'filterpy'}, 'arithmetic: c is a filter of this'),
    ],
)
def test_where_it_is_not_possible_it_is_refused(name, values, says):
    with pytest.raises(ValueError, match=says):
        estimation(name, arithmetic='c', **values)


@pytest.mark.parametrize('name', mostly_thorough(SUPPORTED, 'lidar_radar'))
def test_the_nodes_have_the_verdict_and_the_estimates_of_python(name):
    pytest.importorskip('rclpy')
    from kalman_ros.analysis.verdict import judge
    from kalman_ros.harness import Run

    loops = []
    for arithmetic in ('compiled', 'c'):
        with Run(name, only={'estimator': {'arithmetic': arithmetic}}) as run:
            run.advance(max(200.0 / run.scenario.rate, 10.0))  # enough to judge
            loops.append(run.trajectory())
            said = run.reported('estimator', 'arithmetic')
    assert said == 'c'
    python, c = loops
    scale = np.abs(python.estimate).max(axis=0)
    assert np.all(np.abs(c.estimate - python.estimate) <= 1e-9 * scale)
    verdicts = [[check.passed for check in judge(run.scenario, loop).checks] for loop in loops]
    assert verdicts[0] == verdicts[1]
