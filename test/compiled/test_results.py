# SPDX-License-Identifier: Apache-2.0
"""Whatever computes, results are the same but for rounding, and name the arithmetic."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from thorough import mostly_thorough, thorough
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
    ('name', 'filter'),
    [
        ('cart_pole', 'ukf'),
        thorough('robot_3d', 'ekf'),
        thorough('robot_3d', 'ukf'),
        thorough('inertial', 'ekf'),
        thorough('inertial', 'ukf'),
        ('lidar_radar', 'ukf'),
        thorough('lidar_radar', 'ekf'),
        ('two_bearings', 'gaussian_sum'),
    ],
)
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
@pytest.mark.parametrize(
    'name', mostly_thorough(['cart_pole', 'robot_2d', 'robot_3d'], 'cart_pole', 'robot_3d')
)
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


@pytest.mark.slow
@pytest.mark.usefixtures('with_casadi')
@pytest.mark.parametrize(
    'rate',
    [
        lambda x, u: [x[1], -9.81 * np.sin(x[0]) + u[0]],
        lambda x, u: np.stack((x[..., 1], -9.81 * np.sin(x[..., 0]) + u[..., 0]), axis=-1),
    ],
)
def test_plain_functions_are_compiled(rate):
    model = kr.continuous_model(rate, [0.0, 0.1], states='angle rate', inputs='torque')
    sensor = kr.sensor(lambda x: [np.sin(x[0])], 0.01)
    t, y = np.arange(20) * 0.1, np.full(20, 0.2)
    fast, plain = (
        kr.filter(model, sensor, t, y, initial=([0.1, 0.0], 0.1), arithmetic=arithmetic)
        for arithmetic in ('compiled', 'numpy')
    )
    assert fast.arithmetic == 'C'
    np.testing.assert_allclose(fast.mean, plain.mean, atol=1e-7)


class Drag(kr.Model):
    """A body on a plane."""

    state, input = kr.Space('p v'), kr.Space('f')

    def __init__(self, c):
        self.c = c

    def derivative(self, x, u):
        return np.stack((x[..., 1], u[..., 0] - self.c * x[..., 1]), axis=-1)

    def noise_density(self, x):
        return np.diag([0.0, 0.01])


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.usefixtures('with_casadi')
def test_members_whose_formulas_differ_are_fitted_as_in_numpy(monkeypatch):
    """A parameter that begins at zero has no term there."""

    def drag(c):
        return Drag(c), kr.sensor([1.0, 0.0], 0.01)

    rng, t = np.random.default_rng(4), np.arange(80) * 0.1
    u, truth, y = np.sign(np.sin(t)), np.zeros(2), []
    for each in u:
        y.append(truth[0] + 0.1 * rng.standard_normal())
        truth = drag(0.5)[0].step(truth, np.array([each]), 0.1)

    def fitted():
        return kr.tune(
            drag, t, np.array(y), u, ([0.0, 0.0], 0.1), fit={'c': 0.0}, linear=['c']
        ).values['c']

    fast = fitted()
    monkeypatch.setenv(VARIABLE, 'numpy')
    assert fast == pytest.approx(fitted(), rel=1e-4)
    assert 0.2 < fast < 0.8


@pytest.mark.slow
def test_the_environment_has_the_last_word(monkeypatch):
    monkeypatch.setenv(VARIABLE, 'numpy')
    assert estimates('cart_pole', arithmetic='compiled').arithmetic == 'numpy'
    monkeypatch.setenv(VARIABLE, 'slow')
    wanted = rf"^{VARIABLE} in the environment: expected compiled or numpy, got 'slow'$"
    with pytest.raises(ValueError, match=wanted):
        estimates('cart_pole')


def test_an_unknown_arithmetic_is_refused(monkeypatch):
    built = kr.load('cart_pole')
    monkeypatch.delenv(VARIABLE, raising=False)
    with pytest.raises(ValueError, match=r"^arithmetic: expected compiled or numpy, got 'C'$"):
        kr.filter(built, None, [0.0], [[0.0, 0.0]], arithmetic='C')


@pytest.mark.slow
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
        ({name: Outcome(None, 'numpy', 'none') for name in ('model', 'radar')}, 'numpy (none)'),
    ],
)
def test_what_computes_in_words(outcomes, words):
    assert Parts(None, {}, outcomes).arithmetic == words
