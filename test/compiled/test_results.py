# SPDX-License-Identifier: Apache-2.0
"""Whatever computes, results are the same but for rounding, and name the arithmetic."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from tuned_cases import COVERED, likelihood, recorded

import kalman_ros as kr
from kalman_ros import scenario
from kalman_ros.compiled import Outcome
from kalman_ros.compiled.derived import Derived
from kalman_ros.compiled.parts import VARIABLE, Parts, parts
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file


def drive(name, seconds=4.0):
    """Return a scenario with the readings and inputs of a simulated run."""
    built = kr.load(name)
    return built, kr.simulate(built, seconds=seconds, seed=4)


def estimates(name, **options):
    built, run = drive(name)
    readings = {sensor: series.values for sensor, series in run.readings.items()}
    times = {sensor: series.time for sensor, series in run.readings.items()}
    inputs = run.input if built.model.input.size else None
    return kr.filter(
        built, None, times, readings, inputs, input_times=run.time if inputs is not None else None,
        **options,
    )  # fmt: skip


@pytest.fixture
def with_casadi(monkeypatch, tmp_path_factory):
    pytest.importorskip('casadi', reason='the extra kalman_ros[compiled] is not installed')
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path_factory.getbasetemp()))


@pytest.mark.slow
@pytest.mark.usefixtures('with_casadi')
@pytest.mark.parametrize(
    'name', ['cart_pole', 'robot_3d', 'inertial', 'lidar_radar', 'two_bearings']
)
@pytest.mark.parametrize('filter', ['ekf', 'ukf', 'gaussian_sum'])
def test_estimates_and_smoothed_ones_are_those_of_numpy(name, filter):
    fast = estimates(name, filter=filter)
    plain = estimates(name, filter=filter, arithmetic='numpy')
    assert (fast.arithmetic, plain.arithmetic) == ('C', 'numpy')
    # in numpy, the Jacobian of a barometer is numerical
    close = 1e-6 if name == 'inertial' and filter != 'ukf' else 1e-10
    pairs = [(fast, plain)]
    if filter != 'gaussian_sum':
        pairs.append((kr.smooth(fast), kr.smooth(plain)))
    for mine, theirs in pairs:
        assert np.abs(mine.mean - theirs.mean).max() < close * np.abs(theirs.mean).max()
        scale = np.abs(theirs.covariance).max(axis=(1, 2), keepdims=True)
        assert (np.abs(mine.covariance - theirs.covariance) / scale).max() < close
    assert fast.counts == plain.counts


@pytest.mark.slow
@pytest.mark.usefixtures('with_casadi')
@pytest.mark.parametrize('name', ['cart_pole', 'robot_2d', 'robot_3d'])
def test_many_runs_are_those_of_numpy(name, monkeypatch):
    fast = kr.monte_carlo(name, runs=3, seconds=2.0)
    monkeypatch.setenv(VARIABLE, 'numpy')
    plain = kr.monte_carlo(name, runs=3, seconds=2.0)
    for mine, theirs in zip(compared(fast), compared(plain)):
        np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-9)
    assert any(np.any(mine != theirs) for mine, theirs in zip(compared(fast), compared(plain)))


def compared(runs):
    return runs.step_rms, runs.step_std, runs.step_anees


@pytest.mark.slow
@pytest.mark.usefixtures('with_casadi')
@pytest.mark.parametrize('case', COVERED[1:], ids=lambda case: case.name)
def test_likelihoods_of_many_sets_of_numbers_are_those_of_numpy(case, monkeypatch):
    """With gradient and information: members have different numbers, which C is given."""
    data = recorded(replace(case, seconds=2.0), 3)
    fast = likelihood(case, data)
    assert isinstance(fast.candidate(fast.start).filter.model, Derived)
    monkeypatch.setenv(VARIABLE, 'numpy')
    plain = likelihood(case, data)
    mine, theirs = (asdict(each.expand(each.start)) for each in (fast, plain))
    for name, value in theirs.items():
        np.testing.assert_allclose(mine[name], value, rtol=1e-6, atol=1e-6 * np.abs(value).max())


def test_the_environment_has_the_last_word(monkeypatch):
    monkeypatch.setenv(VARIABLE, 'numpy')
    assert estimates('cart_pole', arithmetic='compiled').arithmetic == 'numpy'
    monkeypatch.setenv(VARIABLE, 'slow')
    with pytest.raises(ValueError, match=r"^arithmetic: expected compiled or numpy, got 'slow'$"):
        estimates('cart_pole')


def test_an_unknown_arithmetic_is_refused(monkeypatch):
    built = kr.load('cart_pole')
    monkeypatch.delenv(VARIABLE, raising=False)
    with pytest.raises(ValueError, match=r"^arithmetic: expected compiled or numpy, got 'C'$"):
        kr.filter(built, None, [0.0], [[0.0, 0.0]], arithmetic='C')


def test_without_casadi_numpy_computes_and_it_is_said_why(monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr('kalman_ros.compiled.find_spec', lambda _: None)
    found = estimates('cart_pole')
    assert found.arithmetic == 'numpy (CasADi is not installed)'
    built = scenario.build(from_file(shipped.file('cart_pole'), 'estimator'))
    assert parts(built.model, {}).model is built.model


@pytest.mark.parametrize(
    ('outcomes', 'words'),
    [
        ({}, 'numpy'),
        ({'model': Outcome(None, 'C')}, 'C'),
        ({'model': Outcome(None, 'C'), 'radar': Outcome(None, 'C')}, 'C'),
        (
            {'model': Outcome(None, 'C'), 'radar': Outcome(None, 'numpy', 'it decides')},
            'model: C; radar: numpy (it decides)',
        ),
        (
            {name: Outcome(None, 'numpy', 'none') for name in ('model', 'radar')},
            'numpy (none)',
        ),
    ],
)
def test_what_computes_in_words(outcomes, words):
    assert Parts(None, {}, outcomes).arithmetic == words
