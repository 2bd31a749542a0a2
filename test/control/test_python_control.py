# SPDX-License-Identifier: Apache-2.0
"""python-control as an oracle, where it is installed, on random systems."""

import numpy as np
import pytest
from seeds import first_fast
from thorough import mostly_thorough

from kalman_ros.control.compensator import compensator, current_compensator
from kalman_ros.control.lqe import dlqe, lqe
from kalman_ros.control.lqr import cost, dlqr, lqr
from kalman_ros.control.margins import margins
from kalman_ros.control.state_space import state_space, static
from kalman_ros.linear.placement import place
from kalman_ros.linear.structure import controllability, observability

# a module of it, since this very folder may pass for a package named control
pytest.importorskip('control.statesp', reason='python-control is not installed')
control = pytest.importorskip('control')

SEEDS = first_fast(range(10), 4)


def random_problem(seed, m=2, k=2):
    rng = np.random.default_rng(seed)
    n = 2 + seed % 3
    A, B, C = rng.normal(size=(n, n)), rng.normal(size=(n, m)), rng.normal(size=(k, n))
    Q, R = rng.uniform(0.1, 2.0, n), rng.uniform(0.1, 2.0, m)
    W, V = rng.uniform(0.1, 2.0, n), rng.uniform(0.1, 2.0, k)
    N = 0.05 * rng.normal(size=(n, m))
    return A, B, C, np.diag(Q), np.diag(R), N, np.diag(W), np.diag(V)


@pytest.mark.parametrize('seed', SEEDS)
def test_lqr(seed):
    A, B, _, Q, R, N, *_ = random_problem(seed)
    weights = cost(Q, R, B.shape, N)
    for ours, theirs in ((lqr, control.lqr), (dlqr, control.dlqr)):
        found = ours(A, B, weights)
        K, S, poles = theirs(A, B, Q, R, N)
        np.testing.assert_allclose(found.gain, K, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(found.cost_to_go, S, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(np.poly(found.poles), np.poly(poles), rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize('seed', SEEDS)
def test_lqe(seed):
    A, _, C, *_, W, V = random_problem(seed)
    L, P, _ = control.lqe(A, np.eye(len(A)), C, W, V)
    found = lqe(A, C, W, V)
    np.testing.assert_allclose(found.gain, L, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found.covariance, P, rtol=1e-6, atol=1e-8)
    # of the sampled filter it gives the predictor's gain and the covariance before the reading
    L, P, _ = control.dlqe(A, np.eye(len(A)), C, W, V)
    found = dlqe(A, C, W, V)
    np.testing.assert_allclose(found.predictor_gain, L, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found.prior, P, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize('seed', SEEDS)
def test_place_with_one_input(seed):
    A, B, *_ = random_problem(seed, m=1)
    poles = -1.0 - np.arange(len(A))
    K = np.atleast_2d(control.acker(A, B, poles))
    np.testing.assert_allclose(place(A, B, poles).gain, K, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize('seed', SEEDS)
def test_place_with_two_inputs(seed):
    A, B, *_ = random_problem(seed)
    poles = -1.0 - np.arange(len(A))
    found, K = place(A, B, poles), control.place(A, B, poles)
    np.testing.assert_allclose(np.sort(found.poles.real), np.sort(poles), rtol=1e-6)
    # there are many gains; ours is as robust, by the condition of the eigenvectors
    ours, theirs = (
        np.linalg.cond(np.linalg.eig(A - B @ gain).eigenvectors) for gain in (found.gain, K)
    )
    assert ours < 1.01 * theirs


@pytest.mark.parametrize('seed', SEEDS)
def test_structure(seed):
    A, B, C, *_ = random_problem(seed, m=1, k=1)
    if seed % 2:
        A[1:, 0], B[1:], C[0, 1:] = 0.0, 0.0, 0.0
    names = tuple('abcd'[: len(A)])
    full = np.linalg.matrix_rank(control.ctrb(A, B)) == len(A)
    assert (not controllability(A, B, names).unreached) == full
    full = np.linalg.matrix_rank(control.obsv(A, C)) == len(A)
    assert (not observability(A, C, names).unseen) == full


def loop(seed, dt):
    A, B, C, Q, R, _, W, V = random_problem(seed, m=1, k=1)
    plant = state_space(A, B, C, dt=dt)
    weights = cost(Q, R, B.shape)
    if dt is None:
        H = compensator(plant, lqr(A, B, weights).gain, lqe(A, C, W, V).gain)
    else:
        H = current_compensator(
            plant, static(dlqr(A, B, weights).gain, plant.dt), dlqe(A, C, W, V)
        )
    ours = H @ plant
    theirs = control.ss(ours.A, ours.B, ours.C, ours.D, *([] if dt is None else [dt]))
    return ours, theirs


@pytest.mark.parametrize('dt', [None, 0.2])
@pytest.mark.parametrize('seed', SEEDS)
def test_stability_margins(seed, dt):
    """It lists every crossing; those next to no change at all are the margins."""
    ours, theirs = loop(seed, dt)
    found = margins(ours)
    gains, phases, *_ = control.stability_margins(theirs, returnall=True)
    # it leaves out the ends of the axis, and what is at infinity it finds by rounding
    ends = [0.0] if dt is None else [1.0, -1.0]
    gains = np.concatenate((gains, [-1.0 / theirs(end).real for end in ends], [0.0, np.inf]))
    gains = np.where(gains > 1e10, np.inf, gains)
    turns = np.radians((phases + 180.0) % 360.0 - 180.0)
    nearest = {
        'upper_gain': gains[gains > 1.0].min(),
        'lower_gain': gains[(gains < 1.0) & (gains >= 0.0)].max(),
        'lag': np.append(turns[turns > 0.0], np.inf).min(),
        'lead': np.append(-turns[turns < 0.0], np.inf).min(),
    }
    for name, value in nearest.items():
        # of a sampled loop it finds crossings as roots of long polynomials: three digits are sure
        np.testing.assert_allclose(getattr(found, name).value, value, rtol=1e-3, atol=1e-9)
    # its response where we found a crossing is exact
    for margin in (found.upper_gain, found.lower_gain):
        if 0.0 < margin.value < np.inf:
            response = theirs(point(margin.frequency, dt))
            np.testing.assert_allclose(-1.0 / response, margin.value, rtol=1e-7, atol=1e-7)
    for margin, sign in ((found.lag, -1.0), (found.lead, 1.0)):
        if margin.value < np.inf:
            response = theirs(point(margin.frequency, dt)) * np.exp(sign * 1j * margin.value)
            np.testing.assert_allclose(response, -1.0, rtol=1e-7, atol=1e-7)


def point(w, dt):
    """Return where in the complex plane the frequency ``w`` is."""
    return 1j * w if dt is None else np.exp(1j * w * dt)


@pytest.mark.parametrize('dt', [None, 0.2])
@pytest.mark.parametrize('seed', mostly_thorough(SEEDS, *SEEDS[:3]))
def test_disk_margins(seed, dt):
    ours, theirs = loop(seed, dt)
    found = margins(ours).disk
    w = np.logspace(-3, 3, 3000) if dt is None else np.linspace(1e-4, np.pi / dt, 3000)
    if 0.0 < found.frequency < w[-1]:
        w = np.sort(np.append(w, found.frequency))
    alpha, gain, phase = control.disk_margins(theirs, w, skew=0.0)
    np.testing.assert_allclose(found.alpha, alpha, rtol=1e-3)
    np.testing.assert_allclose(20.0 * np.log10(found.upper_gain), gain, rtol=2e-3)
    np.testing.assert_allclose(np.degrees(found.phase), phase, rtol=2e-3)
