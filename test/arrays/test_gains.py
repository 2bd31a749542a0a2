# SPDX-License-Identifier: Apache-2.0
"""Gains from matrices as people type them, against published values."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from thorough import mostly_thorough

import kalman_ros as kr
from kalman_ros.arrays import text
from kalman_ros.core import DesignError

A, B = [[0, 1], [0, 0]], [[0], [1]]
CHAIN = kr.continuous_model(A, B, [0, 1], states=['x [m]', 'v [m/s]'])


def test_lqr_of_the_double_integrator():
    # Drake's LQR tests
    gain = kr.lqr(A, B, np.eye(2), 1)
    np.testing.assert_allclose(gain.gain, [[1.0, 3**0.5]], atol=1e-10)
    np.testing.assert_allclose(gain.cost_to_go, [[3**0.5, 1.0], [1.0, 3**0.5]], atol=1e-10)
    np.testing.assert_allclose(kr.lqr(A, B, np.eye(2), 1, [1, 0]).gain, [[1.0, 1.0]], atol=1e-10)
    sampled = kr.dlqr([[1, 1], [0, 1]], [0, 1], [1, 1], 1)
    np.testing.assert_allclose(sampled.gain, [[0.422082440385453, 1.243928853903714]], atol=1e-10)


@pytest.mark.parametrize(
    'given',
    [
        (A, B, [1, 1], 1),
        (A, [0, 1], np.eye(2), [1]),
        (np.array(A), np.array(B), 1.0, [[1.0]]),
        (tuple(map(tuple, A)), (0, 1), np.float64(1.0), np.int32(1)),
        (CHAIN, np.eye(2), 1),
        (SimpleNamespace(A=A, B=B, dt=0), np.eye(2), 1),
        (SimpleNamespace(A=A, B=B, dt=None), 1, 1),
    ],
)
def test_whatever_people_type(given):
    np.testing.assert_allclose(kr.lqr(*given).gain, [[1.0, 3**0.5]], atol=1e-10)


def test_by_keyword():
    np.testing.assert_allclose(kr.lqr(A=A, B=B, Q=1, R=1).gain, kr.lqr(CHAIN, Q=1, R=1).gain)


def test_python_control_is_understood():
    pytest.importorskip('control.statesp', reason='python-control is not installed')
    control = pytest.importorskip('control')
    system = control.ss(A, B, [[1, 0]], 0)
    K, S, E = control.lqr(system, np.eye(2), 1)
    ours = kr.lqr(system, np.eye(2), 1)
    np.testing.assert_allclose(ours.gain, K, atol=1e-9)
    (k, s, e), L = ours, kr.lqe(A, np.eye(2), [[1, 0]], np.eye(2), 1)
    np.testing.assert_allclose(s, S, atol=1e-9)
    np.testing.assert_allclose(np.sort(e), np.sort(E), atol=1e-9)
    np.testing.assert_allclose(k, K, atol=1e-9)
    theirs, P, _ = control.lqe(A, np.eye(2), [[1, 0]], np.eye(2), [[1]])
    np.testing.assert_allclose(L, theirs, atol=1e-8)
    np.testing.assert_allclose(L.covariance, P, atol=1e-8)
    step = [[1, 1], [0, 1]], np.eye(2), [[1, 0]], np.eye(2), [[1]]
    theirs, P, _ = control.dlqe(*step)
    L, prior, _ = kr.dlqe(*step)
    np.testing.assert_allclose(L, theirs, atol=1e-8)
    np.testing.assert_allclose(prior, P, atol=1e-8)
    loop = control.ss([[0.9]], [[1.0]], [[0.3]], 0, 0.1)
    assert kr.margins(loop).delay.frequency > 0.0
    transfer = control.tf([1], [1, 1])
    np.testing.assert_allclose(kr.lqr(transfer, 1, 1).K, control.lqr(-1, 1, 1, 1)[0], atol=1e-9)


@pytest.mark.slow
def test_the_response_of_an_observer_is_that_of_its_recursion(tmp_path):
    """A reading exp(i w k) gives estimates X exp(i w k), with X the response at w."""
    F, _, Q, dt = kr.discretize(A, dt=0.1, W=1.0)
    C, w = np.array([[1.0, 0.0]]), 2.0
    gain = kr.dlqe(F, C, Q, 0.1, dt=dt)
    x = np.zeros(2, dtype=complex)
    for k in range(4000):
        prior = F @ x
        x = prior + gain.gain @ (np.exp(1j * w * dt * k) - C @ prior)
    (found,) = gain.response.response([w])
    np.testing.assert_allclose(x / np.exp(1j * w * dt * 3999), found[:, 0], atol=1e-9)
    continuous = kr.lqe(A, C, 1.0, 0.1)
    (found,) = continuous.response.response([w])
    wanted = np.linalg.solve(1j * w * np.eye(2) - A + continuous.gain @ C, continuous.gain)
    np.testing.assert_allclose(found, wanted, atol=1e-12)
    for each in (gain, continuous, kr.loop_shaping(A, B, C).estimator):
        each.plot(tmp_path / 'response.png')
        assert (tmp_path / 'response.png').stat().st_size > 5000


def test_a_gain_is_the_matrix_in_arithmetic():
    gain, x = kr.lqr(A, B, 1, 1), np.array([1.0, 0.0])
    np.testing.assert_allclose(-gain @ x, [-1.0])
    np.testing.assert_allclose(np.linalg.eigvals(np.array(A) - B @ gain), gain.poles)
    np.testing.assert_allclose(np.asarray(2.0 * gain), 2.0 * gain.gain)
    K, S, E = gain
    assert K is gain.gain and S is gain.cost_to_go and E is gain.poles


def test_it_prints_what_it_is():
    assert str(kr.lqr(A, B, [1, 1], 1)).splitlines() == [
        'State feedback u = -K x, in continuous time',
        '      x0     x1',
        'K u0   1  1.732',
        'poles [1/s] -0.866 ± 0.5j',
        '         x0     x1',
        'S x0  1.732      1',
        'S x1      1  1.732',
        'margins at u0: gain 0 to inf, lead any, lag 72.4 deg, delay 0.695 s, disk 1.31,',
        '  min|1 + L| 1',
    ]
    assert 'K u0' in repr(kr.lqr(CHAIN, 1, 1, dt=0.1))
    assert 'the input held for 0.1 s' in repr(kr.lqr(CHAIN, 1, 1, dt=0.1))
    assert '-0.7321, -2.732' in repr(kr.place([[0, 1], [2, 0]], [0, 1], [-2.732, -0.7321]))
    assert 'the closed loop is not stable' in repr(kr.place(A, B, [1, 2]))
    for result in (kr.lqe(A, [1, 0], 1, 1), kr.discretize(A, B, 0.1), kr.margins(A, B, [1, 1])):
        assert ' at 0x' not in repr(result)


def test_a_sampled_gain_has_the_published_margins():
    # Michigan's cart-pole at 100 Hz: phase margin 53.39 deg
    model = kr.load('cart_pole').model
    gain = kr.lqr(model, [5000, 0, 100, 0], 1, dt=0.01)
    (margins,) = gain.margins
    np.testing.assert_allclose(np.degrees(margins.lag.value), 53.39, atol=1e-2)
    assert kr.margins(gain) == margins
    assert kr.margins(gain.plant.A, gain.plant.B, gain, dt=0.01) == margins


def test_lqe_and_its_published_values():
    # Drake, and Altair's lqe
    np.testing.assert_allclose(kr.lqe(A, [1, 0], 1, 1).gain, [[3**0.5], [1.0]], atol=1e-9)
    found = kr.lqe([[-1, 0.1], [0, -2]], [1, 0], 0.1, 1)
    np.testing.assert_allclose(found.gain, [[0.04889], [0.00082]], atol=5e-6)
    W = np.diag([0.0, 1.0])
    by_noise = kr.lqe(A, [0, 1], [1, 0], 1, 0.5)
    np.testing.assert_allclose(by_noise.gain, kr.lqe(A, [1, 0], W, 0.5).gain)


def test_lqe_of_a_model_and_its_sensors():
    found = kr.lqe(CHAIN, kr.sensor([1, 0], 0.25), dt=0.1)
    F, _, Q, _ = kr.discretize(CHAIN, 0.1)
    np.testing.assert_allclose(found.gain, kr.dlqe(F, [1, 0], Q, 0.25).gain)
    np.testing.assert_allclose(found.gain, kr.lqe(A, [1, 0], [0, 1], 0.25, dt=0.1).gain)
    two = [kr.sensor([1, 0], 0.25), kr.sensor([0, 1], 1.0)]
    assert kr.lqe(CHAIN, two, dt=0.1).gain.shape == (2, 2)
    with pytest.raises(ValueError, match='dt: expected the seconds between readings'):
        kr.lqe(CHAIN, two)


def test_discretize():
    F, G, Q, dt = kr.discretize(A, B, 0.5, [0, 2.0])
    np.testing.assert_allclose(F, [[1, 0.5], [0, 1]])
    np.testing.assert_allclose(G, [[0.125], [0.5]])
    np.testing.assert_allclose(Q, 2.0 * np.array([[0.5**3 / 3, 0.125], [0.125, 0.5]]))
    assert dt == 0.5
    np.testing.assert_allclose(kr.discretize(CHAIN, 0.5).F, F)
    assert kr.discretize(A, None, 0.5).G.shape == (2, 0)


def test_place():
    np.testing.assert_allclose(kr.place(A, B, [-1, -2]).gain, [[2.0, 3.0]])
    np.testing.assert_allclose(kr.place(CHAIN, [-1, -2]).gain, [[2.0, 3.0]])
    sampled = kr.place(A, B, [-1, -2], dt=0.1)
    np.testing.assert_allclose(np.sort(sampled.poles), np.exp([-0.2, -0.1]))


@pytest.mark.parametrize(
    ('call', 'says'),
    [
        (lambda: kr.lqr(A, B, 1), 'R: expected numbers, got nothing'),
        (lambda: kr.lqr(A), 'B: expected numbers, got nothing'),
        (lambda: kr.lqr([[0, 1]], B, 1, 1), r'A: expected a square matrix, got shape \(1, 2\)'),
        (lambda: kr.lqr(A, [1, 2, 3], 1, 1), r'B: expected 2 rows, one a state, got shape \(3, 1'),
        (lambda: kr.lqr(A, B, [1, 2, 3], 1), 'Q: expected a 2 x 2 matrix, its diagonal or one'),
        (lambda: kr.lqr(A, B, 1, -1), 'R: expected a positive definite matrix'),
        (lambda: kr.lqr(A, B, 1, 1, dt=-1), 'dt: expected a positive number of seconds, got -1'),
        (lambda: kr.lqr('abc', B, 1, 1), 'A: expected a matrix or a model, got .abc'),
        (lambda: kr.lqr(kr.load('level').model, 1, 1), 'B: expected at least one input'),
        (lambda: kr.lqe(A, [1, 0, 0], 1, 1), 'C: expected 2 columns, one a state'),
        (lambda: kr.lqe(A, [1, 0], 1, 0), 'V: expected a positive definite matrix'),
        (lambda: kr.place(A, B), 'poles: expected 2 numbers, one a state, got nothing'),
        (lambda: kr.place(A, B, 'fast'), 'poles: expected 2 numbers, one a state, got str'),
        (lambda: kr.place(A, B, {}), 'poles: expected 2 numbers, one a state, got dict'),
        (lambda: kr.place(A, B, np.eye(2)), r'poles: expected 2 numbers, .* got shape \(2, 2\)'),
        (lambda: kr.margins(A, B, np.eye(2)), 'C: expected a row for each of 1 inputs, got 2'),
        (lambda: kr.discretize(A, B), 'dt: expected a number of seconds, got nothing'),
        (lambda: kr.discretize(A, B, np.eye(2)), 'dt: expected a number of seconds, got ndarray'),
        (
            lambda: kr.discretize([[800, 1], [0, 700]], B, 2.0),
            'the model grows beyond all numbers within a step of 2 s',
        ),
    ],
)
def test_mistakes_are_named(call, says):
    with pytest.raises(ValueError, match=f'^{says}'):
        call()


def test_margins_of_several_inputs_say_what_all_tolerate_at_once():
    # the satellite of K. Zhou, J. Doyle and K. Glover, Robust and Optimal Control, 1996, section
    # 9.6: each loop alone looks perfect; gains 1 + e and 1 - e are the end at e = 1 / sqrt(101)
    found = kr.margins([[0, 10], [-10, 0]], np.eye(2), [[1, 10], [-10, 1]])
    assert all(at.disk.alpha == pytest.approx(2.0) for at in found)
    assert 1.09 < found.all_at_once.upper_gain < 1.11
    assert 'all inputs at once: gain 0.905 to 1.1, phase ±5.71 deg' in str(found)
    assert 'at once' not in str(kr.margins(kr.lqr([[0, 1], [0, 0]], [0, 1], 1, 1)))


def test_a_gain_of_several_inputs_prints_what_all_tolerate_at_once():
    gain = kr.lqr([[0, 10], [-10, 0]], np.eye(2), 1, 1)
    assert 'margins at all inputs at once: gain 0 to inf, phase ±90 deg, disk 2' in str(gain)


@pytest.mark.parametrize(
    ('design', 'R', 'what'),
    [
        (kr.lqr, 0.0, 'definite'), (kr.lqr, -1.0, 'definite'), (kr.lqr, 1e-300, 'definite'),
        (kr.lqr, 1e300, 'definite'), (kr.dlqr, -1.0, 'semi-definite'),
        (kr.dlqr, 1e-300, 'definite'), (kr.dlqr, 1e300, 'definite'),
    ],
)  # fmt: skip
def test_a_weight_that_no_design_has_is_named_as_it_was_given(design, R, what):
    with pytest.raises(DesignError, match=f'^R: expected a positive {what} matrix'):
        design([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], np.eye(2), R)


def test_in_discrete_time_an_input_may_be_free():
    # the input that leaves no state one sample later: S = Q where G has an inverse
    gain = kr.dlqr([[2.0, -1.0], [1.0, 0.0]], np.eye(2), 1, 0)
    np.testing.assert_allclose(gain.K, [[2.0, -1.0], [1.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(gain.S, np.eye(2), atol=1e-12)
    # of what costs nothing until a sample later: x1^2 + (x1 + x2)^2 cannot be helped
    later = kr.dlqr([[1.0, 1.0], [0.0, 1.0]], [[0.0], [1.0]], [1.0, 0.0], 0)
    np.testing.assert_allclose(later.S, [[2.0, 1.0], [1.0, 1.0]], atol=1e-12)
    with pytest.raises(DesignError, match=r'^R: expected a positive definite matrix'):
        kr.dlqr([[1.0, 1.0], [0.0, 1.0]], [[0.0], [1.0]], [0.0, 0.0], 0)


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize('dt', mostly_thorough([None, 0.1], 0.1))
def test_a_gain_draws_its_loops(dt, tmp_path):
    two = kr.lqr([[0, 1], [-2, -0.5]], np.eye(2), np.eye(2), np.eye(2), dt=dt)
    two.plot(tmp_path / 'loops.png')
    assert (tmp_path / 'loops.png').stat().st_size > 20_000
    first, second = kr.margins(two)
    assert first.loop.C.tolist() != second.loop.C.tolist()
    kr.margins(two).plot(tmp_path / 'both.png')
    assert (tmp_path / 'both.png').stat().st_size > 20_000
    kr.margins([[1, 1], [0, 1]], [[0], [1]], [[10, 10]]).plot(tmp_path / 'one.png')
    assert (tmp_path / 'one.png').stat().st_size > 20_000
    with pytest.raises(kr.DesignError, match='stable'):
        replace(two, gain=-100.0 * two.gain).plot(tmp_path / 'none.png')
    assert not (tmp_path / 'none.png').exists()


def test_what_is_wide_is_printed_in_parts():
    rng = np.random.default_rng(0)
    A, B = rng.normal(size=(12, 12)) - 3.0 * np.eye(12), rng.normal(size=(12, 2))
    found = kr.lqr(A, B, np.eye(12), np.eye(2))
    shown = [found, kr.discretize(A, B, 0.1, np.eye(12)), kr.margins(A, B, found.K)]
    shown += [kr.margins(A, B[:, :1], kr.lqr(A, B[:, :1], np.eye(12), [[1]]).K)]
    for each in shown:
        assert max(map(len, repr(each).splitlines())) <= text.WIDTH
    printed = ' '.join(repr(found).split())
    assert all(f'x{index} ' in printed for index in range(12))
    assert repr(shown[-1]).splitlines()[-1].startswith('  min|1 + L| ')
    # a name that leaves no room has a column all the same
    (_, line) = text.matrix(['a'], [100 * 'x'], np.ones((1, 1)))
    assert line.split() == ['a', '1']


def test_rounding_is_printed_as_zero():
    lines = text.matrix(['a', 'b'], ['x', 'y'], np.array([[2.846e-34, 0.4142], [1e-9, 2.0]]))
    assert [line.split() for line in lines] == [
        ['x', 'y'],
        ['a', '0', '0.4142'],
        ['b', '1e-09', '2'],
    ]


def test_a_gain_of_many_states_prints_at_once():
    gain = kr.lqr(np.diag(np.linspace(-3.0, -1.0, 120)), np.ones((120, 1)), 1, 1)
    assert '.margins computes them' in str(gain) and 'margins at' not in str(gain)
    vars(gain)['margins'] = kr.lqr([[0, 1], [0, 0]], [0, 1], 1, 1).margins  # as if asked for
    assert 'margins at' in str(gain)
    assert 'margins at' in str(kr.lqr([[0, 1], [0, 0]], [0, 1], 1, 1))
