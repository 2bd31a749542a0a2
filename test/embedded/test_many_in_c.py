# SPDX-License-Identifier: Apache-2.0
"""Many runs by the exported filter: those of Python, one belief as one of many."""

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.core import unchecked
from kalman_ros.embedded.filter_in_c import FilterInC
from kalman_ros.pipeline.settings import settings
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file

pytest.importorskip('casadi')
from exported import needs_a_compiler

pytestmark = [pytest.mark.slow, needs_a_compiler]


@pytest.fixture(autouse=True)
def _exact_derivatives(monkeypatch):
    monkeypatch.setenv('KALMAN_ROS_ARITHMETIC', 'compiled')


@pytest.fixture
def cart_pole():
    values = {**from_file(shipped.file('cart_pole'), 'estimator'), 'arithmetic': 'c'}
    return settings(values).fusion(wait=True)


@pytest.mark.parametrize(
    ('name', 'overrides'),
    [
        ('cart_pole', {}), ('cart_pole', {'filter': 'ukf'}), ('diff_drive', {}),
        ('mass_spring_damper_2d', {}), ('mass_spring_damper_2d', {'filter': 'luenberger'}),
        ('cart_pole', {'joint_states.gate': 0.9}),
    ],
)  # fmt: skip
def test_runs_are_those_of_python(name, overrides):
    kept = {'runs': 12, 'seconds': 1.0, 'seed': 4}
    expected = kr.monte_carlo(name, overrides, **kept)
    found = kr.monte_carlo(name, overrides, **kept, arithmetic='c')
    for attribute in ('rms', 'std', 'anees'):
        values = [np.asarray(getattr(each, attribute), float) for each in (found, expected)]
        np.testing.assert_allclose(*values, rtol=1e-9)
    assert str(found) == str(expected)


@pytest.mark.parametrize('late', [{'joint_states.delay': 0.03}, {'joint_states.jitter': 0.02}])
def test_late_readings_are_those_of_python_too(late, counted):
    kept = {'runs': 3, 'seconds': 1.0, 'seed': 4}
    expected = kr.monte_carlo('cart_pole', late, **kept)
    assert not counted
    found = kr.monte_carlo('cart_pole', late, **kept, arithmetic='c')
    assert len(counted) > 100
    np.testing.assert_allclose(found.rms, expected.rms, rtol=1e-9)
    counted.clear()
    run = found.run(1)
    assert len(counted) > 100
    np.testing.assert_allclose(run.estimate, expected.run(1).estimate, rtol=1e-7, atol=1e-12)
    with pytest.raises(ValueError, match='c is not possible here: filter: .* got square_root'):
        kr.monte_carlo('cart_pole', {'filter': 'square_root', **late}, **kept, arithmetic='c')


@pytest.fixture
def counted(monkeypatch):
    """Return the steps of predictions in C."""
    calls, predict = [], FilterInC.predict

    def counting(self, belief, u, dt):
        calls.append(dt)
        return predict(self, belief, u, dt)

    monkeypatch.setattr(FilterInC, 'predict', counting)
    return calls


def test_other_processes_have_it_too():
    kept = {'runs': 6, 'seconds': 0.5, 'seed': 4, 'arithmetic': 'c'}
    alone, shared = (kr.monte_carlo('cart_pole', **kept, workers=count) for count in (1, 2))
    np.testing.assert_array_equal(alone.rms, shared.rms)


def test_each_of_many_is_the_one_and_one_that_fails_leaves_the_others(cart_pole):
    filter, sensor = cart_pole.filter.stacked(), cart_pole.sensors['joint_states']
    rng = np.random.default_rng(2)
    x = rng.normal(size=(5, 4))
    P = np.stack([np.diag(rng.uniform(0.1, 1.0, 4)) for _ in x])
    u, y = rng.normal(size=(5, 1)), rng.normal(size=(5, 2))
    x[2], P[3] = 1e200, -P[3]
    moved = filter.predict(unchecked((x, P)), u, 0.01)
    read = filter.correct(unchecked((x, P)), y, sensor)
    for k in (0, 1, 4):
        one = unchecked((x[k].copy(), P[k].copy()))
        predicted = cart_pole.filter.predict(one, u[k], 0.01)
        corrected = cart_pole.filter.correct(one, y[k], sensor)
        np.testing.assert_array_equal(moved.mean[k], predicted.mean)
        np.testing.assert_array_equal(moved.covariance[k], predicted.covariance)
        np.testing.assert_array_equal(read.posterior.mean[k], corrected.posterior.mean)
        np.testing.assert_array_equal(
            read.innovation_covariance[k], corrected.innovation_covariance
        )
        assert read.nis[k] == corrected.nis
    assert np.isnan(moved.mean[2]).all() and np.isnan(read.posterior.mean[3]).all()


def test_a_covariance_that_all_share_is_that_of_each(cart_pole):
    filter, shared = cart_pole.filter.stacked(), cart_pole.initial.covariance
    x = np.random.default_rng(2).normal(size=(3, 4))
    found = filter.predict(unchecked((x, shared)), np.zeros(1), 0.01)
    each = filter.predict(unchecked((x, np.stack([shared] * 3))), np.zeros((3, 1)), 0.01)
    np.testing.assert_array_equal(found.mean, each.mean)
    np.testing.assert_array_equal(found.covariance, each.covariance)


@pytest.mark.parametrize(
    ('options', 'says'),
    [
        ({'arithmetic': 'C'}, "^arithmetic: expected 'compiled' or 'c', got 'C'$"),
        ({'overrides': {'filter': 'square_root'}, 'arithmetic': 'c'}, '^arithmetic: c is not'),
    ],
)
def test_what_c_has_not_is_refused_in_one_line(options, says):
    with pytest.raises(ValueError, match=says):
        kr.monte_carlo('cart_pole', runs=2, seconds=0.1, **options)
