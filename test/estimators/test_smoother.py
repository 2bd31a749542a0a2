# SPDX-License-Identifier: Apache-2.0
"""The smoother against batch least squares, against filterpy, and on published data."""

import numpy as np
import pytest
from random_systems import Linear, random_problem
from recorded import data
from seeds import first_fast
from thorough import mostly_thorough

import kalman_ros as kr
from kalman_ros.core import Gaussian, LinearSystem, Model, Space
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.estimators.plan import Plan
from kalman_ros.estimators.smoother import Filtered, smooth


def least_squares(system, prior, stamps, inputs, readings):
    """Return means and covariances of the states at all stamps, from one whitened system.

    ``inputs`` are in effect from each stamp on; ``readings`` are (index, C, R, y).
    """
    n, N = system.state.size, len(stamps)
    rows, right = [], []

    def add(covariance, blocks, value):
        white = np.linalg.inv(np.linalg.cholesky(covariance))
        row = np.zeros((len(value), n * N))
        for index, block in blocks.items():
            row[:, n * index : n * (index + 1)] = block
        rows.append(white @ row)
        right.append(white @ value)

    add(prior.covariance, {0: np.eye(n)}, prior.mean)
    for k in range(N - 1):
        step = system.sampled((stamps[k + 1] - stamps[k]) * 1e-9)
        add(step.Q, {k: -step.F, k + 1: np.eye(n)}, step.G @ inputs[k])
    for index, C, R, y in readings:
        add(R, {index: C}, y)
    A = np.vstack(rows)
    means = np.linalg.lstsq(A, np.concatenate(right), rcond=None)[0].reshape(N, n)
    whole = np.linalg.inv(A.T @ A)
    blocks = [whole[n * k : n * (k + 1), n * k : n * (k + 1)] for k in range(N)]
    return means, np.array(blocks)


@pytest.mark.slow
@pytest.mark.parametrize('filter', ['kf', 'ekf', 'ukf'])
@pytest.mark.parametrize('seed', first_fast(range(5), 2))
def test_it_is_batch_least_squares(seed, filter):
    """With uneven steps, inputs, two sensors, late rows, readings missing whole or in part."""
    rng, system, first, prior = random_problem(seed)
    other = Linear(rng.normal(size=(1, 4)), np.array([[0.5]]), 'z')
    stamps = np.cumsum(rng.integers(20_000_000, 300_000_000, 25)).tolist()
    times, u = np.array(stamps) * 1e-9, rng.normal(size=(25, 2))
    y, z = rng.normal(size=(25, 2)), rng.normal(size=25)
    y[[3, 4, 20]] = np.nan
    y[7, 0] = y[11, 1] = np.nan
    z[rng.random(25) < 0.6] = np.nan
    known = []
    for k in range(25):
        there = np.isfinite(y[k])
        if there.any():
            R = first.covariance[np.ix_(there, there)]
            known.append((k, first.C[there], R, y[k][there]))
        if np.isfinite(z[k]):
            known.append((k, other.C, other.covariance, z[k : k + 1]))
    means, covariances = least_squares(system, prior, stamps, u, known)
    order = rng.permutation(25)
    found = kr.filter(
        system, [first, other], times[order], {'y': y[order], 'z': z[order]}, u[order], prior,
        filter=filter,
    )  # fmt: skip
    np.testing.assert_array_equal(found.time, times)
    np.testing.assert_allclose(found.mean[-1], means[-1], rtol=1e-9, atol=1e-9)
    smoothed = kr.smooth(found)
    np.testing.assert_allclose(smoothed.mean, means, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(smoothed.covariance, covariances, rtol=1e-9, atol=1e-9)


def test_absent_rows_are_as_good_as_nan():
    rng, system, sensor, prior = random_problem(3)
    times, y = np.arange(30) * 0.1, rng.normal(size=(30, 2))
    y[rng.random(30) < 0.5] = np.nan
    y[0] = 1.0
    there = np.isfinite(y[:, 0])
    whole = kr.smooth(kr.filter(system, sensor, times, y, None, prior))
    fewer = kr.smooth(kr.filter(system, sensor, times[there], y[there], None, prior))
    np.testing.assert_allclose(whole.mean[there], fewer.mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(whole.covariance[there], fewer.covariance, rtol=1e-9, atol=1e-9)


def test_it_is_filterpy_on_a_random_system():
    kalman = pytest.importorskip('filterpy.kalman')
    rng = np.random.default_rng(5)
    F, H = np.eye(3) + 0.2 * rng.normal(size=(3, 3)), rng.normal(size=(2, 3))
    Q, R = np.diag([0.1, 0.2, 0.3]), np.diag([0.5, 0.7])
    zs = rng.normal(size=(40, 2))
    peer = kalman.KalmanFilter(dim_x=3, dim_z=2)
    peer.F, peer.H, peer.Q, peer.R, peer.P = F, H, Q, R, 4.0 * np.eye(3)
    means, covariances, _, _ = peer.batch_filter(zs[:, :, np.newaxis])
    expected, P, *_ = peer.rts_smoother(means, covariances)
    # filterpy predicts before the first reading
    prior = F @ np.zeros(3), F @ (4.0 * np.eye(3)) @ F.T + Q
    found = kr.filter(kr.discrete_model(F, Q=Q), (H, R), None, zs, initial=prior)
    np.testing.assert_allclose(found.mean, means[:, :, 0], rtol=1e-9)
    smoothed = kr.smooth(found)
    np.testing.assert_allclose(smoothed.mean.ravel(), np.ravel(expected), rtol=1e-8)
    np.testing.assert_allclose(smoothed.covariance, P, rtol=1e-8, atol=1e-10)


def nile():
    flows = np.loadtxt(data('nile.csv'), delimiter=',', skiprows=1, usecols=1)
    return flows, kr.discrete_model([[1.0]], Q=1469.1, states=['level'])


def test_the_nile():
    flows, model = nile()
    found = kr.filter(model, (1.0, 15099.0), None, flows, initial=(0.0, 1e7))
    # Durbin and Koopman, Time Series Analysis by State Space Methods (2012), section 2.2
    np.testing.assert_allclose(found.log_likelihood, -641.5856, atol=5e-5)
    np.testing.assert_allclose(found.covariance[[0, -1], 0, 0], [15076.24, 4032.16], atol=5e-3)


#: Smoothed levels and variances by statsmodels 0.15.0, UnobservedComponents 'local level' with
#: initialize_known([0], [[1e7]]), at some years; in the second case years 21 to 40 and 61 to 80
#: are missing.
STATSMODELS = [
    (
        [],
        [0, 1, 28, 50, 98, 99],
        [1111.2202575681306, 1110.529257011893, 950.930012017348, 829.550451101484,
         804.0495956662394, 798.3702926083578],
        [4030.532767337336, 3242.0569992450105, 2326.7569171991554, 2326.756869814384,
         3242.9300732249244, 4032.1579418087827],
    ),
    (
        [*range(20, 40), *range(60, 80)],
        [0, 19, 30, 39, 70, 99],
        [1110.8730218203627, 999.7107833551363, 893.7909246519295, 807.1292220765786,
         837.4061174524068, 798.3151146175683],
        [4030.5615997215937, 3614.4034005995477, 9715.005540580709, 4723.59745233473,
         9715.005902461402, 4032.1867974482548],
    ),
]  # fmt: skip


@pytest.mark.parametrize(('missing', 'years', 'levels', 'variances'), STATSMODELS)
def test_statsmodels_on_the_nile(missing, years, levels, variances):
    flows, model = nile()
    flows[missing] = np.nan
    smoothed = kr.smooth(kr.filter(model, (1.0, 15099.0), None, flows, initial=(0.0, 1e7)))
    np.testing.assert_allclose(smoothed.mean[years, 0], levels, rtol=1e-10)
    np.testing.assert_allclose(smoothed.covariance[years, 0, 0], variances, rtol=1e-9)


class Pendulum(Model):
    state = Space(('theta', 'omega'), ('rad', 'rad/s'), angles=('theta',))
    input = Space(('u',), ('',))
    max_step = 0.1

    def derivative(self, x, u):
        return np.stack((x[..., 1], u[..., 0] - 4.0 * np.sin(x[..., 0])), axis=-1)

    def state_jacobian(self, x, u):
        return np.array([[0.0, 1.0], [-4.0 * np.cos(x[0]), 0.0]])

    def input_jacobian(self, x, u):
        return np.array([[0.0], [1.0]])

    def noise_density(self, x):
        return np.diag([0.0, 0.1])


def runs(model, sensor, prior, count, steps, dt, filter):
    """Yield truth, filtered and smoothed estimates of runs whose truths are drawn from a prior."""
    for seed in range(count):
        rng = np.random.default_rng(seed)
        x, u = rng.multivariate_normal(*prior), rng.normal(size=(steps, model.input.size))
        truth, y = [], []
        for k in range(steps):
            truth.append(x)
            noise = rng.multivariate_normal(np.zeros(len(sensor.covariance)), sensor.covariance)
            y.append(sensor.output.wrap(sensor.measure(x) + noise))
            Q = model.transition(x, u[k], dt).Q
            x = model.step(x, u[k], dt) + rng.multivariate_normal(np.zeros(x.size), Q)
            x = model.state.wrap(x)
        found = kr.filter(model, sensor, np.arange(steps) * dt, y, u, prior, filter=filter)
        yield np.array(truth), found, kr.smooth(found)


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize('filter', mostly_thorough(['kf', 'ekf', 'ukf'], 'ukf'))
def test_it_is_never_worse_than_the_filter_and_consistent(filter):
    """Over 200 runs, at every time and in every state; the pendulum turns over, past +-pi."""
    count, steps, dt = 200, 12, 0.1
    if filter == 'kf':
        model = kr.continuous_model([[0, 1], [-1, -0.2]], [0, 1], [0.0, 0.2])
        sensor, prior = kr.sensor([1, 0], 0.04), (np.zeros(2), np.diag([1.0, 1.0]))
    else:
        model = Pendulum()
        sensor = kr.sensor(lambda x: x[..., :1], 0.01, 'angle', angles=['angle'])
        prior = np.array([np.pi - 0.2, 2.0]), np.diag([0.04, 0.04])
    errors, values = [], []
    for truth, found, smoothed in runs(model, sensor, prior, count, steps, dt, filter):
        each = [model.state.subtract(truth, e.mean) for e in (found, smoothed)]
        errors.append(each)
        values.append(nees(each[1], smoothed.covariance))
    filtered, smoothed = np.sqrt(np.mean(np.square(errors), axis=0))
    # where they differ only by one or two later readings, the scatter of 200 runs may differ
    assert np.all(smoothed <= filtered * 1.02)
    assert np.all(smoothed[: steps // 2] < filtered[: steps // 2] * 0.95)
    low, high = chi_square_bounds(1.0, 2.0 / (2 * count), 1e-4)
    anees = np.mean(values, axis=0) / 2
    assert np.all((low <= anees) & (anees <= high)), anees


def test_a_restart_tells_nothing_of_what_was_before():
    _, system, _, prior = random_problem(0)
    filter = build_filter('kf', Plan(system, {}, 10.0))
    steps = [Filtered(k * 10**8, prior, np.zeros(2), restarted=k == 2) for k in range(4)]
    found = smooth(filter, steps)
    np.testing.assert_array_equal(found[1].mean, steps[1].belief.mean)
    assert np.any(found[2].mean != steps[2].belief.mean)


def test_a_reading_at_the_gate_breaks_the_chain_only_when_the_belief_was_widened():
    model = kr.discrete_model([[1.0]], Q=0.01)
    y = np.zeros(40)
    y[10] = 50.0
    found = kr.filter(model, (1.0, 0.1), None, y, initial=(0.0, 1.0), gates=0.999)
    assert found.counts == {'y': {'fused': 39, 'rejected: outside the gate': 1}}
    assert np.abs(kr.smooth(found).mean).max() < 1e-9


@pytest.mark.parametrize('filter', ['gaussian_sum', 'steady_state', 'luenberger'])
def test_filters_whose_gains_are_not_optimal_are_refused(filter):
    model = kr.continuous_model([[0, 1], [0, 0]], W=[0, 1])
    found = kr.filter(
        model, ([1, 0], 1.0), np.arange(5.0), np.ones(5), initial=([0, 0], 1), filter=filter,
        options={'observer_poles': [-0.4, -0.5]} if filter == 'luenberger' else None,
    )  # fmt: skip
    with pytest.raises(ValueError, match=r'filter: expected one of \(kf, ekf, ukf'):
        kr.smooth(found)
    with pytest.raises(ValueError, match=r'estimates: expected what kr.filter returns, got \(\)'):
        kr.smooth(())


def test_a_state_without_noise_is_smoothed():
    """A constant that nothing drives: every instant knows as much as the last."""
    space = Space(('bias', 'x'), ('', ''))
    system = LinearSystem(
        [[0, 0], [1, 0]], np.zeros((2, 0)), np.diag([0, 0.1]), space, Space((), ())
    )
    y = np.random.default_rng(1).normal(size=50)
    found = kr.filter(
        system, ([0, 1], 0.1), np.arange(50.0), y, initial=Gaussian([0, 0], np.eye(2))
    )
    smoothed = kr.smooth(found)
    np.testing.assert_allclose(smoothed.mean[:, 0], found.mean[-1, 0], rtol=1e-9)
    np.testing.assert_allclose(smoothed.std[:, 0], found.std[-1, 0], rtol=1e-9)
