# SPDX-License-Identifier: Apache-2.0
"""Designs compared with independent computations, and the errors of bad ones."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag, expm, solve_discrete_are
from thorough import mostly_thorough

from kalman_ros import scenario
from kalman_ros.analysis.bounds import posterior_cramer_rao
from kalman_ros.analysis.checks import theory
from kalman_ros.analysis.design_theory import report, settling_time
from kalman_ros.analysis.design_warnings import notes, warnings
from kalman_ros.analysis.path import default_seconds, follow
from kalman_ros.core import DesignError, Gaussian
from kalman_ros.scenario.parameter_files import from_file


def build(**values):
    return scenario.build({name.replace('__', '.'): value for name, value in values.items()})


@cache
def cart_pole(delay=0.0):
    """Return the report of the cart-pole, which several tests look at."""
    return report(build(model='cart_pole'), delay)


def sampled(A, B, W, dt, parts=4000):
    """Return F, G and Q by exponentials, and by the midpoint rule."""
    F = expm(A * dt)
    h, half = dt / parts, expm(A * dt / parts / 2)
    G, Q, inner = np.zeros_like(B), np.zeros_like(A), half
    step = half @ half
    for _ in range(parts):
        G, Q, inner = G + h * inner @ B, Q + h * inner @ W @ inner.T, step @ inner
    return F, G, Q


def sampled_weights(A, B, Q, R, dt, parts=4000):
    """Return the weight of (x, u) over a sample by the midpoint rule."""
    n, m = B.shape
    M = np.block([[A, B], [np.zeros((m, n + m))]])
    h = dt / parts
    inner, step = expm(M * h / 2), expm(M * h)
    total = np.zeros((n + m, n + m))
    for _ in range(parts):
        total, inner = total + h * inner.T @ block_diag(Q, R) @ inner, step @ inner
    return total


def gain_of(F, G, weight):
    n = len(F)
    Q, N, R = weight[:n, :n], weight[:n, n:], weight[n:, n:]
    S = solve_discrete_are(F, G, Q, R, s=N)
    return np.linalg.solve(R + G.T @ S @ G, G.T @ S @ F + N.T)


def poles(modes):
    s = np.array([mode.pole for mode in modes])
    return np.sort_complex(np.concatenate((s, s[s.imag > 0].conj())))


# of mass_spring_damper_2d, written out once more
A = np.array([[0, 1, 0, 0], [-2, -0.4, 0, 0], [0, 0, 0, 1], [0, 0, -1, -0.2]])
B = np.array([[0, 0], [1, 0], [0, 0], [0, 1.0]])
W = np.diag([0, 0.1, 0, 0.1])
POSITION, VELOCITY = np.eye(4)[[0, 2]], np.eye(4)[[1, 3]]


@pytest.fixture(scope='module')
def spring():
    """Return gain, cost, and the steady state of (x, x_hat) by brute force, phase by phase."""
    F, G, Q = sampled(A, B, W, 0.01)
    weight = sampled_weights(A, B, np.diag([20.0, 2, 20, 2]), np.eye(2), 0.01)
    K = gain_of(F, G, weight)
    both = np.vstack((POSITION, VELOCITY)), np.diag([0.05**2] * 2 + [0.5**2] * 2)
    schedule = [both, *[(VELOCITY, np.eye(2) * 0.5**2)] * 4]
    P, joint, gains = np.eye(4), np.eye(8), []
    errors, joints = [], []
    for k in range(2000):
        C, R = schedule[k % 5]
        prior = F @ P @ F.T + Q
        P = np.linalg.inv(np.linalg.inv(prior) + C.T @ np.linalg.inv(R) @ C)
        L = P @ C.T @ np.linalg.inv(R)
        # (x, x_hat) in absolute terms, not as (x, e)
        M = np.block([[F, -G @ K], [L @ C @ F, (np.eye(4) - L @ C) @ (F - G @ K) - L @ C @ G @ K]])
        through = np.vstack((np.eye(4), L @ C))
        read = np.vstack((np.zeros((4, len(C))), L))
        joint = M @ joint @ M.T + through @ Q @ through.T + read @ R @ read.T
        errors.append(P)
        joints.append(joint)
        gains.append(L)
    return K, weight, np.array(errors[-5:]), np.array(joints[-5:]), gains[-5:]


@pytest.mark.slow
def test_the_spring_is_as_worked_out_by_brute_force(spring):
    K, weight, errors, joints, gains = spring
    found = report(build())
    np.testing.assert_allclose(found.regulator.feedback.gain, K, rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(
        found.estimator.std**2, errors.diagonal(axis1=1, axis2=2).mean(axis=0), rtol=1e-6
    )
    np.testing.assert_allclose(found.estimator.gains['position'], gains[0][:, :2], atol=1e-7)
    slow = [gains[0][:, 2:], *gains[1:]]
    np.testing.assert_allclose(found.estimator.gains['velocity'], np.mean(slow, axis=0), atol=1e-7)
    u = joints[:, 4:, 4:]
    closed = found.closed_loop
    x = joints[:, :4, :4].diagonal(axis1=1, axis2=2).mean(axis=0)
    np.testing.assert_allclose(closed.state_std**2, x, rtol=1e-5)
    inputs = (K @ u @ K.T).diagonal(axis1=1, axis2=2).mean(axis=0)
    np.testing.assert_allclose(closed.input_std**2, inputs, rtol=1e-5)
    stacked = block_diag(np.eye(4), -K)
    cost = np.trace(weight @ stacked @ joints.mean(axis=0) @ stacked.T) / 0.01
    np.testing.assert_allclose(closed.cost, cost, rtol=1e-5)


@pytest.mark.slow
def test_the_modes_of_the_spring_are_those_of_the_real_loop(spring):
    K, _, _, _, gains = spring
    found = report(build())
    F, G, _ = sampled(A, B, W, 0.01)
    regulator = np.log(np.linalg.eigvals(F - G @ K).astype(complex)) / 0.01
    np.testing.assert_allclose(poles(found.regulator.modes), np.sort_complex(regulator), rtol=1e-5)
    over = np.eye(4)
    for L in gains:
        C = VELOCITY if L.shape[1] == 2 else np.vstack((POSITION, VELOCITY))
        over = (np.eye(4) - L @ C) @ F @ over
    estimator = np.log(np.linalg.eigvals(over).astype(complex)) / 0.05
    np.testing.assert_allclose(poles(found.estimator.modes), np.sort_complex(estimator), rtol=1e-5)
    np.testing.assert_allclose(poles(found.modes), np.sort_complex(np.linalg.eigvals(A)))
    slowest = max(1 / abs(s.real) for s in (*regulator, *estimator))
    np.testing.assert_allclose(found.closed_loop.settling_time, np.log(1e3) * slowest, rtol=1e-5)
    every = (*found.regulator.modes, *found.estimator.modes)
    np.testing.assert_allclose(settling_time(every), theory(build()).settling_time, rtol=1e-9)


def michigan():
    """The linearised cart-pole of the control tutorials of the University of Michigan."""
    M, m, b, inertia, g, length = 0.5, 0.2, 0.1, 0.006, 9.8, 0.3
    p = inertia * (M + m) + M * m * length**2
    A = [
        [0, 1, 0, 0],
        [0, -(inertia + m * length**2) * b / p, m**2 * g * length**2 / p, 0],
        [0, 0, 0, 1],
        [0, -m * length * b / p, m * g * length * (M + m) / p, 0],
    ]
    B = [[0], [(inertia + m * length**2) / p], [0], [m * length / p]]
    return np.array(A), np.array(B)


class Brute:
    """The cart-pole's closed loop with a factor on its input, or with its input late."""

    def __init__(self, share=1, covariance=None):
        A, B = michigan()
        W = np.zeros((4, 4))
        H = np.array([[B[1, 0], 0.06 * B[1, 0] / 0.024], [B[3, 0], 0.7 * B[3, 0] / 0.06]])
        W[1::2, 1::2] = H @ np.diag([0.001, 1e-5]) @ H.T
        self.F, self.G, Q = sampled(A, B, W, 0.01)
        self.K = gain_of(
            self.F, self.G, sampled_weights(A, B, np.diag([5000.0, 0, 100, 0]), np.eye(1), 0.01)
        )
        C, R = np.eye(4)[[0, 2]], np.diag([0.005**2, 0.01**2])
        self.corrections, P = [], np.eye(4)
        for k in range(4000):
            P = self.F @ P @ self.F.T + Q
            LC = np.zeros((4, 4))
            if k % share == 0:
                L = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
                P, LC = (np.eye(4) - L @ C) @ P, L @ C
            self.corrections.append(LC)
        self.P, self.corrections = P, self.corrections[-share:]

    def grows(self, factor=1.0, late=0, estimate=True):
        """Return whether the loop grows, with whole samples of delay; state (x, x_hat, inputs)."""
        F, G, K = self.F, self.G, self.K
        over = np.eye(8 + late, dtype=complex)
        for LC in self.corrections if estimate else [np.eye(4)]:
            M = np.zeros((8 + late, 8 + late), dtype=complex)
            M[:4, :4] = F
            if late:
                M[:4, 8] = factor * G[:, 0]
                M[8:-1, 9:] = np.eye(late - 1)
                M[-1, 4:8] = -K[0]
            else:
                M[:4, 4:8] = -factor * G @ K
            M[4:8] = LC @ M[:4]
            M[4:8, 4:8] += (np.eye(4) - LC) @ (F - G @ K)
            over = M @ over
        return np.abs(np.linalg.eigvals(over)).max() > 1.0


@cache
def brute_force(share=1):
    """Return the cart-pole's loop by brute force, with a reading every share-th step."""
    return Brute(share)


@pytest.mark.thorough
@pytest.mark.slow
def test_the_margins_of_the_cart_pole_are_where_its_real_loop_ends():
    brute, found = brute_force(), cart_pole()
    np.testing.assert_allclose(found.regulator.feedback.gain, brute.K, rtol=1e-4)
    np.testing.assert_allclose(found.estimator.std**2, brute.P.diagonal(), rtol=1e-4)
    (at,) = found.regulator.loops
    for loop, estimate in ((at.known, False), (at.estimated, True)):
        bears = loop.margins
        for gain, sign in ((bears.lower_gain, -1), (bears.upper_gain, 1)):
            assert not brute.grows(gain.value * (1 - 1e-3 * sign), estimate=estimate)
            assert brute.grows(gain.value * (1 + 1e-3 * sign), estimate=estimate)
        phase = min(bears.lag.value, bears.lead.value)
        assert not brute.grows(np.exp(1j * phase * 0.999), estimate=estimate)
        assert brute.grows(np.exp(1j * phase * 1.001), estimate=estimate)
        whole = int(bears.delay.value / 0.01)
        assert not brute.grows(late=whole, estimate=estimate)
        assert brute.grows(late=whole + 1, estimate=estimate)
    assert at.known.margins.lag.value > at.guarantee.phase
    # the tutorial's design at 100 Hz; there the cost is not sampled exactly, which shifts it a bit
    np.testing.assert_allclose(np.degrees(at.known.margins.lag.value), 53.39, atol=0.1)
    np.testing.assert_allclose(np.degrees(at.guarantee.phase), 52.0, atol=0.1)


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize('share', mostly_thorough([2, 5], 5))
def test_lqg_margins_of_a_slow_sensor_are_close_to_those_of_the_real_loop(share):
    """A reading every share-th step: the report's loop has one at each, with more noise."""
    found = report(build(model='cart_pole', joint_states__rate=100.0 / share))
    brute = brute_force(share)
    np.testing.assert_allclose(found.estimator.std, np.sqrt(brute.P.diagonal()), rtol=0.2)
    bears = found.regulator.loops[0].estimated.margins
    for value, end in ((bears.upper_gain.value, 1.1), (bears.lower_gain.value, 0.95)):
        assert not brute.grows(1.0 + (value - 1.0) * 0.85)
        assert brute.grows(value * end)
    phase = bears.lag.value
    assert not brute.grows(np.exp(1j * phase * 0.94))
    assert brute.grows(np.exp(1j * phase * 1.06))
    assert any('each sensor reads at every step' in note for note in notes(found))


@pytest.mark.slow
def test_a_delay_leaves_less_and_is_the_same_in_the_real_loop():
    brute = brute_force()
    found = cart_pole(0.01).regulator.loops[0].estimated
    for gain, sign in ((found.margins.lower_gain, -1), (found.margins.upper_gain, 1)):
        assert not brute.grows(gain.value * (1 - 1e-3 * sign), late=1)
        assert brute.grows(gain.value * (1 + 1e-3 * sign), late=1)
    np.testing.assert_allclose(found.prompt.delay.value - found.margins.delay.value, 0.01)


def nile():
    rates = {'rate': 1.0, 'reading__rate': 1.0}
    noise = {'model_parameters__noise_density': 1469.1, 'reading__noise': [15099**0.5]}
    return build(model='level', initial_std=[1e7**0.5], **rates, **noise)


def test_a_model_without_inputs_has_an_estimator_and_its_published_errors():
    # J. Durbin and S. Koopman, Time Series Analysis by State Space Methods, 2012, section 2.2.5
    found = report(nile())
    assert found.regulator is None and found.controllability is None and found.closed_loop is None
    np.testing.assert_allclose(found.estimator.std**2, 4032.16, atol=0.005)
    variances = found.prediction.std[:, 0] ** 2
    np.testing.assert_allclose(variances[:2], (1e7, 15076.24), atol=0.005)
    np.testing.assert_allclose(variances[-1], 4032.16, rtol=1e-4)
    assert found.prediction.time[:3].tolist() == [0.0, 0.0, 1.0]
    assert warnings(found, 1.0) == () and found.sensor_std == {'level': 15099**0.5}


@pytest.mark.slow
@pytest.mark.parametrize('model', ['turn_rate', 'constant_velocity'])
def test_a_tracker_is_judged_along_its_path_and_not_at_one_point(model):
    built = build(model=model)
    found = report(built, duration=8.0)
    np.testing.assert_array_equal(found.point.state, built.initial_belief.mean)
    assert found.path.time[-1] == 8.0 and found.observability.unseen == ()
    assert found.path.observed(throughout=True) == built.model.state.names
    np.testing.assert_array_equal(found.prediction.std[1:], found.path.std)
    assert any('Along a simulated path of 8 s, the readings of each' in n for n in notes(found))
    assert warnings(found, 0.01) == ()


def test_the_error_along_a_path_is_the_bound_there():
    """With readings after the first step only, as the bound has it; linearised at each step."""
    built = build(model='turn_rate')
    found = follow(built, None, 3.0)
    input = np.zeros((len(found.truth), 0))
    first = Gaussian(built.initial_belief.mean, np.diag(found.std[0] ** 2))
    P = posterior_cramer_rao(replace(built, initial_belief=first), found.truth, input)
    # at the first step both sensors read, which leaves small correlations
    np.testing.assert_allclose(found.std[-1], np.sqrt(P[-1].diagonal()), rtol=0.05)


@pytest.mark.slow
def test_a_bearing_alone_tells_no_state_and_the_design_says_so():
    found = report(build(model='bearing_tracker'), duration=60.0)
    assert found.observability.seen == () and found.estimator is None
    assert str(found.observability) == 'the sensors observe none of x, y, v_x, v_y'
    assert any('do not determine x, y, v_x, v_y along' in w for w in warnings(found, 0.01))


@pytest.mark.thorough
@pytest.mark.slow
def test_an_error_that_goes_up_and_down_with_the_path_does_not_grow():
    config = Path(__file__).parents[2] / 'config/lidar_radar.yaml'
    path = report(build(**from_file(config, 'estimator')), duration=60.0).path
    assert np.any(path.std[-1] > 1.05 * path.std[len(path.std) // 2])
    assert path.observed(throughout=True) == path.names and path.growing == ()
    lost = report(build(model='diff_drive'), duration=20.0).path
    # of the place, what grows is across the path
    growing = set(lost.growing)
    assert 'psi' in growing and {'x', 'y'} & growing and not {'v', 'omega'} & growing


def test_a_path_of_no_length_and_one_that_diverges_say_so():
    built = build(model='turn_rate')
    for seconds in (0.0, -1.0, np.nan, 1e9):
        with pytest.raises(ValueError, match='duration: expected 0.04 to 1000 s, got'):
            follow(built, None, seconds)
    with pytest.raises(DesignError, match='does not stay finite'):
        follow(build(model='turn_rate', initial_state=[0, 0, 1e308, 0, 1e308]), None, 5.0)


def test_all_inputs_at_once_bear_no_more_than_one_alone():
    found = report(build()).regulator
    assert found.together.estimated.alpha <= min(
        at.estimated.margins.disk.alpha for at in found.loops
    ) * (1 + 1e-5)


def test_what_is_well_designed_is_not_warned_of():
    found = report(build())
    assert warnings(found, 0.01) == ()
    assert not any('Not linear' in note for note in notes(found))
    assert any('every 5 steps' in note for note in notes(found))


WARNINGS = [
    ({'position__noise': [5.0, 5.0], 'velocity__noise': [50.0, 50.0]}, 0.01,
     ['The estimator is slower than the regulator']),
    ({'model': 'cart_pole'}, 0.01, ['Input f: the LQG loop has small margins, gain 0.729']),
    ({'model': 'cart_pole'}, 0.02, ['Input f: the LQG loop has a delay margin of 0.018',
                                    'Input f: the LQG loop has small margins']),
    ({'model': 'submersible'}, 0.01, ['The readings do not determine x along the']),
    ({'model': 'diff_drive'}, 0.01, ['The readings do not determine x, y, psi along the']),
    ({'sensors': ['position'], 'position__measures': ['x'], 'position__noise': [0.05],
      'position__fields': ['pose.pose.position.x']}, 0.01,
     ['No sensor observes y, v_y: only the model predicts', 'The estimator is slower']),
    ({'model': 'level', 'model_parameters__noise_density': 0.0}, 0.1,
     ['The error has no steady state: a mode that does not decay has no process noise']),
    ({'model': 'linear', 'model_parameters__A': [-1.0, 0.0, 0.0, -1.0],
      'model_parameters__B': [0.0, 1.0]}, 0.01,
     ['No sensor observes v: only the model', 'The input does not control x']),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(('values', 'latency', 'expected'), WARNINGS)
def test_a_warning_says_what_may_go_wrong(values, latency, expected):
    found = cart_pole() if values == {'model': 'cart_pole'} else report(build(**values))
    said = warnings(found, latency)
    for sentence in expected:
        assert sum(warning.startswith(sentence) for warning in said) == 1, said
    assert len(said) == len(expected), said


@pytest.mark.thorough
@pytest.mark.slow
def test_a_delay_that_the_loop_does_not_bear_is_said():
    found = cart_pole(0.02)
    assert found.regulator.loops[0].estimated.margins is None
    assert found.regulator.loops[0].known.margins is not None
    assert warnings(found, 0.02) == (
        'Input f: the LQG loop is unstable with 0.02 s of delay; its delay margin is 0.018 s.',
    )


@pytest.mark.slow
def test_a_robot_on_wheels_is_said_to_be_regulated_along_motions():
    path = Path(__file__).parents[2] / 'docs' / 'examples' / 'robot_on_a_path.yaml'
    found = report(scenario.build(from_file(path, 'estimator', 'controller')))
    assert found.regulator is found.closed_loop is found.controllability is None
    assert any('regulated along motions' in note for note in notes(found))
    assert found.path is not None and 'y' in found.path.observed(throughout=True)
    assert found.prediction.std.shape[1] == 5  # of its filter


REFUSED = [
    ({'model': 'linear', 'model_parameters__A': [1.0, 0.0, 0.0, -1.0],
      'model_parameters__B': [0.0, 1.0]}, 0.0, r'input: it does not move the modes at 1 \(x\)'),
    ({'model': 'linear', 'model_parameters__A': [0.5, 0.0, 0.0, -1.0],
      'model_parameters__B': [1.0, 1.0], 'position__C': [0.0, 1.0]}, 0.0,
     'sensors: no sensor sees the growing mode at 0.5'),
    ({'position__enabled': False, 'velocity__enabled': False}, 0.0,
     'sensors: expected at least one that is enabled'),
    ({}, -0.1, 'delay: expected 0 to 1 s, got -0.1'),
    ({}, 2.0, 'delay: expected 0 to 1 s, got 2'),
]  # fmt: skip


@pytest.mark.parametrize(('values', 'delay', 'says'), REFUSED)
def test_what_has_no_design_says_why(values, delay, says):
    with pytest.raises(ValueError, match=says):
        report(build(**values), delay)


def test_a_loop_that_cannot_be_designed_is_a_design_error():
    with pytest.raises(DesignError):
        report(build(**REFUSED[0][0]))


@pytest.mark.slow
def test_integral_action_is_reported_as_what_it_is():
    found = report(build(law='lqi'))
    law, dt = found.regulator.feedback, 0.01
    F, G, _ = sampled(A, B, W, dt, parts=1)

    def loop(factor):
        g = np.diag([factor, 1.0])  # at the first input alone
        return np.block(
            [[F - G @ g @ law.gain, -G @ g @ law.integral_gain], [dt * POSITION, np.eye(2)]]
        )

    expected = np.sort_complex(np.log(np.linalg.eigvals(loop(1.0)).astype(complex)) / dt)
    np.testing.assert_allclose(poles(found.regulator.modes), expected, rtol=1e-4)
    at = found.regulator.loops[0]
    most = at.known.margins.upper_gain.value
    for factor, stable in ((0.999 * most, True), (1.001 * most, False)):
        assert (np.abs(np.linalg.eigvals(loop(factor))).max() < 1.0) == stable
    assert at.guarantee is None
    assert found.closed_loop.cost > report(build()).closed_loop.cost


def test_placed_poles_are_reported_as_what_they_are():
    found = report(build(law='placement', regulator_poles=[-1.0, -2.0, -3.0, -4.0]))
    np.testing.assert_allclose(poles(found.regulator.modes), [-4, -3, -2, -1], atol=1e-6)
    assert all(at.guarantee is None for at in found.regulator.loops)
    assert found.closed_loop.cost > report(build()).closed_loop.cost


@pytest.mark.slow
def test_a_path_is_as_long_as_a_demo_if_that_is_not_too_many_steps():
    fine, coarse = (build(model='bearing_tracker', rate=rate) for rate in (100.0, 1.0))
    assert default_seconds(coarse, 1800.0) == 1800.0
    assert default_seconds(fine, 1800.0) == default_seconds(fine) == 60.0
    path = report(fine, followed=coarse, duration=1800.0).path
    assert path.time[-1] == 1800.0
    assert len(path.time) == 1801
