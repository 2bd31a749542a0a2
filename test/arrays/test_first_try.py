# SPDX-License-Identifier: Apache-2.0
"""What people type who know python-control and filterpy: it is right, or one line helps."""

import re

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.elsewhere import ELSEWHERE

A, B = [[0, 1], [-2, -0.5]], [[0], [1]]
Q, R = np.diag([10, 1]), 1
MODEL = kr.continuous_model(A, B, 0.1)
FREE = kr.continuous_model([[0, 1], [0, 0]], W=[0, 0.1])
GPS = kr.sensor([1, 0], 0.1)
TIMES = np.arange(20) * 0.1
READINGS = np.sin(TIMES)
PRIOR = ([0, 0], [1, 1])
GAIN = kr.lqr(A, B, Q, R)
PLACED = kr.place(A, B, [-1, -2])
OBSERVER = kr.lqe(A, np.eye(2), [[1, 0]], 0.1 * np.eye(2), [[0.1]])
FOUND = kr.filter(FREE, GPS, TIMES, READINGS, initial=PRIOR)


class Frame:
    """What numpy takes for an array, as a DataFrame is."""

    def __init__(self, values):
        self.values = np.array(values, dtype=float)

    def __array__(self, dtype=None, copy=None):
        return np.array(self.values, dtype=dtype)


def filtered(times=TIMES, readings=READINGS, sensors=GPS, model=FREE, initial=PRIOR, **others):
    return kr.filter(model, sensors, times, readings, initial=initial, **others)


def gain_of(*arguments, **options):
    return kr.lqr(*arguments, **options).gain


SAME_GAIN = {
    'nested lists': lambda: gain_of(A, B, [[10, 0], [0, 1]], [[1]]),
    'a flat B': lambda: gain_of(A, [0, 1], Q, R),
    'a diagonal for Q': lambda: gain_of(A, B, [10, 1], R),
    'keywords': lambda: gain_of(A=A, B=B, Q=Q, R=R),
    'a model': lambda: gain_of(MODEL, Q, R),
    'a model and keywords': lambda: gain_of(MODEL, Q=Q, R=R),
    'data frames': lambda: gain_of(Frame(A), Frame(B), Frame(Q), Frame([[1]])),
    'unpacked as in python-control': lambda: (lambda K, S, E: K)(*kr.lqr(A, B, Q, R)),
    'the first of the result': lambda: GAIN[0],
    'the matrix as numpy sees it': lambda: np.asarray(GAIN),
}


@pytest.mark.parametrize('how', SAME_GAIN)
def test_every_way_to_ask_for_a_gain_gives_the_same(how):
    np.testing.assert_allclose(SAME_GAIN[how](), GAIN.gain, rtol=1e-9)


RIGHT = {
    'GAIN @ [1, 2]': lambda: (GAIN @ [1, 2], GAIN.gain @ [1, 2]),
    'GAIN[0, 1]': lambda: (GAIN[0, 1], GAIN.gain[0, 1]),
    'A - B @ K': lambda: (np.sort(np.linalg.eigvals(A - B @ PLACED)), [-2, -1]),
    'lqe unpacked': lambda: (
        (lambda L, P, E: L @ [[0.1]])(*OBSERVER), OBSERVER.covariance @ [[1], [0]]),
    'lqe without G': lambda: (kr.lqe(A, [1, 0], 0.1, 0.1).gain, OBSERVER.gain),
    'a scalar plant': lambda: (kr.lqr(1, 1, 1, 1).gain, [[1 + 2**0.5]]),
    'a scalar pole': lambda: (kr.place(1, 1, -1).gain, [[2]]),
    'discretize(A, dt)': lambda: (kr.discretize(A, 0.1).F, kr.discretize(A, B, 0.1).F),
    'lists': lambda: (filtered([*TIMES], [*READINGS]).mean, FOUND.mean),
    'a column': lambda: (filtered(readings=READINGS[:, None]).mean, FOUND.mean),
    'columns of filterpy': lambda: (filtered(readings=READINGS[:, None, None]).mean, FOUND.mean),
    'a data frame': lambda: (filtered(readings=Frame(READINGS[:, None])).mean, FOUND.mean),
    'a pair (H, R)': lambda: (filtered(sensors=([[1, 0]], [[0.1]])).mean, FOUND.mean),
    'a list of a pair': lambda: (filtered(initial=[[0, 0], np.eye(2)]).mean, FOUND.mean),
    'a column for a mean': lambda: (
        filtered(initial=(np.zeros((2, 1)), np.eye(2))).mean, FOUND.mean),
    'capitals': lambda: (filtered(filter='KF').mean, FOUND.mean),
    'None for a gap': lambda: (
        filtered([0, 1, 2], [1, None, 3]).mean, filtered([0, 1, 2], [1, np.nan, 3]).mean),
    'dates': lambda: (
        filtered(np.datetime64('2024-01-01') + np.arange(20) * np.timedelta64(1, 'D')).mean,
        filtered(1.7040672e9 + np.arange(20) * 86400.0).mean),
    'differences of times': lambda: (
        filtered(np.arange(20) * np.timedelta64(100, 'ms')).mean, FOUND.mean),
    'one input for all': lambda: (
        filtered(model=MODEL, inputs=1.0).mean, filtered(model=MODEL, inputs=np.ones(20)).mean),
    'a belief of a time': lambda: (FOUND[3].mean, FOUND.mean[3]),
    'the last belief': lambda: (FOUND[-1].covariance, FOUND.last.covariance),
    'names without units': lambda: (kr.Space('x v').size, kr.Space(['x', 'v']).size),
}  # fmt: skip


@pytest.mark.parametrize('what', RIGHT)
def test_it_is_right(what):
    found, expected = RIGHT[what]()
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)


HELPED = [
    (lambda: kr.lqr(A, [[0, 1]], Q, R), 'B: expected 2 rows, one a state, got shape (1, 2)'),
    (lambda: kr.lqr(A, B, Q, np.eye(2)), 'R: expected a 1 x 1 matrix, its diagonal or one number'),
    (lambda: kr.lqr(A, B, -Q, R), 'Q: expected a positive semi-definite matrix'),
    (lambda: kr.lqr(A, B, Q, 0), 'R: expected a positive definite matrix'),
    (lambda: kr.lqr(A, B, Q), 'R: expected numbers, got nothing'),
    (lambda: kr.lqr([[0, 1], [0]], B, Q, R), 'rows of one length, got [[0, 1], [0]]'),
    (lambda: kr.lqr([[0, 1j], [0, 0]], B, Q, R), 'A: expected real numbers'),
    (lambda: kr.lqr((A, B), Q, R), 'A: expected real numbers, in rows of one length'),
    (lambda: kr.lqr('cart_pole', Q, R), "kr.load('cart_pole').model"),
    (lambda: kr.lqr([[1, 0], [0, 2]], [[1], [0]], Q, R), 'no input can stabilise the modes at 2'),
    (lambda: kr.place(A, B, [-1 + 1j, -2]), 'poles: expected every complex pole with its conj'),
    (lambda: kr.place(A, B, 'fast'), 'poles: expected 2 numbers'),
    (lambda: kr.lqe(A, [1, 0]), 'W: expected numbers, got nothing'),
    (lambda: kr.discretize(A, B), 'dt: expected a number of seconds, got nothing'),
    (lambda: GAIN.L, "StateFeedback has no 'L'; it has E, K, S, T, cost_to_go, dt, gain"),
    (lambda: GAIN.margin, "StateFeedback has no 'margin'; did you mean 'margins'?"),
    (lambda: OBSERVER.K, "Observer has no 'K'; here it is .L"),
    (lambda: FOUND.x, "Estimates has no 'x'; here it is .mean"),
    (lambda: (lambda x, P: x)(*FOUND), 'take .mean (N, n) and .covariance (N, n, n)'),
    (lambda: kr.smooth((FOUND.mean, FOUND.covariance)), 'expected what kr.filter returns, got'),
    (lambda: filtered(initial=None), 'initial: expected a Gaussian or a pair of mean and covar'),
    (lambda: filtered(initial=[0, 0]), "at the first time, or 'diffuse', got [0, 0]"),
    (lambda: filtered(0.1), 'times: expected one time a row, 20, got the number 0.1'),
    (lambda: filtered(None), 'times: expected times (N,) in seconds, got nothing'),
    (lambda: filtered(readings=READINGS[:-1]), 'readings: expected 20 rows, one a time, got 19'),
    (lambda: filtered(readings=READINGS[None, :]), 'readings: expected shape (N, 1), got (1, 20)'),
    (lambda: filtered(filter='kalman'), "unknown filter 'kalman'; known are kf, ekf, ukf"),
    (lambda: filtered(sensors=kr.Sensor), 'got the class Sensor and not an object of it'),
    (lambda: filtered(sensors=[GPS, GPS]), "sensors: expected distinct names, got ['y', 'y']"),
    (lambda: filtered(sensors=kr.sensor([[1], [0]], 0.1)), 'y: expected 2 columns of H'),
    (lambda: filtered(model=A), 'model: expected a model or a scenario, got [[0, 1]'),
    (lambda: kr.continuous_model(A, B), 'W: expected the noise, got nothing; continuous_m'),
    (lambda: kr.discrete_model(A, B), 'Q: expected the noise, got nothing; discrete_model(F'),
    (lambda: kr.continuous_model(lambda x, u: [x[1]], [0, 0.1]), 'expected 2 numbers, got shape'),
    (lambda: kr.continuous_model(lambda t, x: [x[1], 0], [0, 1]), 'given an array of 2 and an ar'),
    (lambda: kr.sensor([1, 0], -0.1), 'R: expected a positive definite matrix'),
    (lambda: kr.simulate('cart-pole'), "did you mean 'cart_pole'?"),
    (lambda: kr.simulate('cart_pole', 10), 'overrides: expected parameters by name, got 10'),
    (lambda: kr.simulate(MODEL), 'got LinearSystem; kr.make_scenario makes one'),
    (lambda: kr.design(MODEL), 'got LinearSystem; kr.make_scenario makes one'),
    (lambda: kr.simulate('cart_pole', seconds=-1), 'seconds: expected a positive number'),
    (lambda: kr.simulate('cart_pole', seconds=1, gain=[1, 2, 3]), 'gain: expected 1 x 4'),
    (lambda: kr.consistency(FOUND, [READINGS, READINGS]), 'truth: expected shape (20, 2)'),
    (lambda: kr.Gaussian([0, 0], [1, 1, 1]), 'covariance: expected 2 x 2 for a mean of 2 numbers'),
    (lambda: kr.Gaussian([0, 0], [[1, 0], [1, 1]]), 'covariance: expected a symmetric matrix'),
    (lambda: kr.filters, "no attribute 'filters'; did you mean 'filter'?"),
    (lambda: kr.EKF, "no attribute 'EKF'; did you mean 'ExtendedKalmanFilter'?"),
    (lambda: kr.c2d, "did you mean 'discretize'?"),
    (lambda: kr.make_scenario(FREE, GPS, rate=10, law='lqgg'), "unknown law 'lqgg'"),
    (lambda: kr.make_scenario(FREE, GPS, rate=10, filter='kff'), "unknown filter 'kff'"),
    (lambda: kr.tune(kr.make_scenario(FREE, GPS, rate=10), [0], [0]), 'give its parts'),
    (lambda: np.asarray(FOUND),
     'take .mean'),
    (lambda: kr.ekf, "did you mean 'ExtendedKalmanFilter'?"),
    (lambda: kr.LQR, "did you mean 'lqr'?"),
    (lambda: kr.kalmd, 'here it is lqe(..., dt=...)'),
    (lambda: kr.rlocus, 'python-control has it'),
    (lambda: kr.bode, "no attribute 'bode'; here it is margins(...).plot()"),
    (lambda: kr.QQQ, "no attribute 'QQQ'; dir(kr) lists its names"),
]  # fmt: skip


@pytest.mark.parametrize(('mistake', 'line'), HELPED, ids=[line for _, line in HELPED])
def test_one_line_helps(mistake, line):
    with pytest.raises((ValueError, TypeError, AttributeError)) as caught:
        mistake()
    assert line in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_every_name_from_elsewhere_leads_to_one_of_ours():
    for there, here in ELSEWHERE.items():
        assert there not in kr.__all__
        name = re.match(r'[a-z_A-Z]+', here).group()
        assert name in kr.__all__ or here.startswith('model.'), here


def test_a_point_may_be_a_state_alone():
    pendulum = kr.continuous_model(
        lambda x, u: np.stack([x[..., 1], -np.sin(x[..., 0])], -1), W=[0, 0.1], states='th w'
    )
    for point in ([np.pi, 0], np.array([np.pi, 0]), ([np.pi, 0], []), {'th': np.pi}):
        np.testing.assert_allclose(kr.linearize(pendulum, point).A, [[0, 1], [1, 0]], atol=1e-6)


@pytest.mark.parametrize(
    ('name', 'here'),
    [
        ('update', r'\.correct\(belief, y, \(H, R\)\)'),
        ('x', "a belief's .mean"),
        ('P', "a belief's .covariance"),
        ('F', r'of \.model'),
        ('batch_filter', r'kr\.filter'),
        ('predikt', "did you mean 'predict'"),
    ],
)
def test_names_of_filterpy_on_a_filter_are_answered(name, here):
    for kind in (kr.KalmanFilter, kr.ExtendedKalmanFilter, kr.UnscentedKalmanFilter):
        filter = kind(kr.discrete_model([[1.0]], Q=[[1.0]]))
        with pytest.raises(AttributeError, match=here):
            getattr(filter, name)


def test_a_model_that_does_not_rest_is_not_linearised_silently():
    model = kr.continuous_model(lambda x, u: np.array([x[1], u[0] - 9.81]), np.eye(2) * 0.1,
                                states='z v', inputs='thrust')  # fmt: skip
    for call in (lambda: kr.linearize(model), lambda: kr.discretize(model, dt=0.1)):
        with pytest.raises(ValueError, match='does not rest where it is linearised'):
            call()
    assert kr.linearize(model, [0.0, 0.0], [9.81]).A.shape == (2, 2)


def test_rounding_prints_as_nothing():
    assert 'e-16' not in str(kr.place([[0, 1], [-2, -0.5]], [[0], [1]], [-1, -2]))
    assert 'gain 0 to inf' in str(kr.place([[0, 1], [0, 0]], np.eye(2), [-1, -1]).margins)
