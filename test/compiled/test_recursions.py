# SPDX-License-Identifier: Apache-2.0
"""Recursions over readings: in C, by numpy, and against whole matrices."""

import numpy as np
import pytest

from kalman_ros.compiled import library, recursions
from kalman_ros.compiled.parts import VARIABLE
from kalman_ros.compiled.recursions import Errors, Rows, follow, respond

pytestmark = pytest.mark.slow  # a compiler is a process
N, SIZES = 4, np.array([1, 3, 2, 3, 1, 2] * 20)
FIRST = np.cumsum(SIZES) - SIZES
COUNT = int(SIZES.sum())


@pytest.fixture(params=['compiled', 'numpy'])
def arithmetic(request, monkeypatch):
    monkeypatch.setenv(VARIABLE, request.param)
    if request.param == 'compiled' and recursions._library() is None:
        pytest.skip('there is no C compiler')
    return request.param


def draws(*shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape)


def steps():
    F = np.eye(N) + 0.1 * draws(len(SIZES), N, N)
    F[:, 0, 1:] = 0.0  # zeros are left out
    return 0.9 * F / np.linalg.norm(F, 2, axis=(1, 2))[:, None, None]


def definite(count, size, seed):
    root = draws(count, size, size, seed=seed)
    return root @ root.swapaxes(1, 2) + 0.5 * np.eye(size)


def readings():
    white = np.tril(draws(len(SIZES), 3, 3, seed=3)) + 2.0 * np.eye(3)
    rows = np.concatenate([each[:k] for each, k in zip(white, SIZES)])
    H, K = draws(COUNT, N, seed=1), 0.1 * draws(COUNT, N, seed=2)
    return Rows(steps(), SIZES, FIRST, H, K, rows, draws(COUNT, seed=4))


def test_responses_are_those_of_one_fault_after_the_other(arithmetic):
    rows, p, first, q = readings(), 7, 2, 3
    added, effects = draws(len(SIZES), N, q, seed=5), draws(COUNT, p, seed=6)
    error, Z = draws(N, p, seed=7), effects.copy()
    start = error.copy()
    respond(rows, added, first, error, Z)
    for fault in range(p):
        e = start[:, fault]
        for i, (k, row) in enumerate(zip(SIZES, FIRST)):
            at = slice(row, row + k)
            e = rows.F[i] @ e
            if first <= fault < first + q:
                e = e + added[i, :, fault - first]
            nu = rows.H[at] @ e + effects[at, fault]
            e = e - rows.K[at].T @ nu
            np.testing.assert_allclose(Z[at, fault], rows.white[at, :k] @ nu, rtol=1e-10)
        np.testing.assert_allclose(error[:, fault], e, rtol=1e-9)


def test_readings_in_parts_have_the_same_responses(arithmetic):
    rows, added = readings(), draws(len(SIZES), N, 5, seed=5)
    whole, error = np.zeros((COUNT, 5)), np.zeros((N, 5))
    respond(rows, added, 0, error, whole)
    parts, error = np.zeros((COUNT, 5)), np.zeros((N, 5))
    for begin, end in ((0, 1), (1, 50), (50, len(SIZES))):
        some = rows.between(begin, end)
        at = slice(FIRST[begin], FIRST[begin] + len(some.H))
        respond(some, added[begin:end], 0, error, parts[at])
    np.testing.assert_allclose(parts, whole, rtol=1e-12)


def errors(count=30):
    sizes = SIZES[:count]
    rows = int(sizes.sum())
    R = np.concatenate([each[:k] for each, k in zip(definite(count, 3, 8), sizes)])
    F, Q = steps()[:count], 0.1 * definite(count, N, 9)
    H, innovation = draws(rows, N, seed=10), draws(rows, seed=11)
    return Errors(F, Q, sizes, FIRST[:count], H, R, innovation, draws(count, N, seed=12))


def gaussian(given, covariance):
    """Return mean and covariance of the errors at all innovations, stacked."""
    count = len(given.F)
    mean, P = [np.zeros(N)], np.zeros((count * N, count * N))
    P[:N, :N] = covariance
    for i in range(1, count):
        F, now, before = given.F[i], slice(i * N, i * N + N), slice(i * N - N, i * N)
        mean.append(F @ (mean[-1] - given.moved[i - 1]))
        P[now, : i * N] = F @ P[before, : i * N]
        P[: i * N, now] = P[now, : i * N].T
        P[now, now] = F @ P[before, before] @ F.T + given.Q[i]
    return np.concatenate(mean), P


def test_the_misfit_is_that_of_all_innovations_at_once(arithmetic):
    given, covariance = errors(), definite(1, N, 13)[0]
    mean, P = gaussian(given, covariance)
    H, R = np.zeros((len(given.H), len(mean))), np.zeros((len(given.H), len(given.H)))
    for i, (k, row) in enumerate(zip(given.sizes, given.first)):
        at = slice(row, row + k)
        H[at, i * N : i * N + N] = given.H[at]
        R[at, at] = given.R[at, :k]
    S, nu = H @ P @ H.T + R, given.innovation - H @ mean
    expected = nu @ np.linalg.solve(S, nu) + np.linalg.slogdet(2.0 * np.pi * S)[1]
    means, covariances = np.empty((len(given.F), N)), np.empty(given.F.shape)
    assert follow(given, covariance) == pytest.approx(expected, rel=1e-10)
    assert follow(given, covariance, (means, covariances)) == pytest.approx(expected, rel=1e-10)
    # the last belief is that given all innovations
    gain = P @ H.T @ np.linalg.inv(S)
    np.testing.assert_allclose(means[-1], (mean + gain @ nu)[-N:], rtol=1e-8)
    after = (P - gain @ H @ P)[-N:, -N:]
    np.testing.assert_allclose(covariances[-1], after, rtol=1e-8, atol=1e-10)


def test_what_is_not_definite_is_refused(arithmetic):
    given = errors()
    with pytest.raises(np.linalg.LinAlgError):
        follow(given._replace(R=-100.0 * given.R), np.eye(N))
    spoilt = given.innovation.copy()
    spoilt[5] = np.nan
    with pytest.raises(np.linalg.LinAlgError):
        follow(given._replace(innovation=spoilt), np.eye(N))


def test_arguments_stay_as_they_are(arithmetic):
    given, covariance = errors(), np.eye(N)
    copies = [np.array(each) for each in given]
    follow(given, covariance)
    np.testing.assert_array_equal(covariance, np.eye(N))
    for each, before in zip(given, copies):
        np.testing.assert_array_equal(each, before)


def test_without_a_compiler_numpy_computes(monkeypatch):
    def fail(source):
        raise library.CompilerError('no C compiler was found')

    monkeypatch.delenv(VARIABLE, raising=False)
    expected = follow(errors(), np.eye(N))
    monkeypatch.setattr(recursions, 'load', fail)
    recursions._library.cache_clear()
    try:
        assert follow(errors(), np.eye(N)) == pytest.approx(expected, rel=1e-12)
    finally:
        recursions._library.cache_clear()
