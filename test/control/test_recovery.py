# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from kalman_ros.control.lqr import cost, dlqr, lqr
from kalman_ros.control.margins import margins
from kalman_ros.control.recovery import recover
from kalman_ros.control.state_space import state_space
from kalman_ros.core import zero_order_hold

# Doyle's example, with the regulator of q = 1
A, B, C = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
NOISES = (np.ones((2, 2)), np.eye(1))
FREQUENCIES = np.logspace(-1, 1, 30)


def regulator_gain():
    return lqr(A, B, cost(np.ones((2, 2)), [1], (2, 1))).gain


def test_the_loop_tends_to_that_of_the_regulator():
    K = regulator_gain()
    designs = recover(state_space(A, B, C), K, NOISES, [0.0, 10.0, 1e2, 1e4, 1e6])
    gaps = [design.gap(FREQUENCIES).max() for design in designs]
    assert gaps[0] > 1.0
    assert np.all(np.diff(gaps) < 0.0)
    # the fast poles of the estimator are at sqrt(q) from the origin: the gap goes as its inverse
    np.testing.assert_allclose(gaps[-2] / gaps[-1], 10.0, rtol=0.1)
    found, target = margins(designs[-1].loop), margins(designs[-1].target)
    np.testing.assert_allclose(found.lag.value, target.lag.value, rtol=0.01)
    np.testing.assert_allclose(found.lower_gain.value, target.lower_gain.value, rtol=0.01)
    np.testing.assert_allclose(found.disk.alpha, target.disk.alpha, rtol=0.01)
    assert found.upper_gain.value > 100.0
    assert margins(designs[0].loop).upper_gain.value < 1.056


def test_each_loop_is_stable_with_the_poles_of_both():
    for design in recover(state_space(A, B, C), regulator_gain(), NOISES, [0.0, 3.0, 30.0]):
        expected = [*np.linalg.eigvals(A - B @ regulator_gain()), *design.estimator.poles]
        found = np.sort_complex(design.loop.closed().poles)
        np.testing.assert_allclose(found, np.sort_complex(expected), rtol=1e-4)


def test_a_zero_in_the_right_half_plane_stands_in_the_way():
    wrong_way = np.array([[1.0, -0.5]])  # 1 - s / 2, except for the shift of the poles
    designs = recover(state_space(A, B, wrong_way), regulator_gain(), NOISES, [1e2, 1e3, 1e4])
    assert min(design.gap(FREQUENCIES).max() for design in designs) > 0.5


def test_in_samples_the_current_reading_recovers_all_of_it():
    # C G is not zero and the plant's zero is within the circle: the gap vanishes (Maciejowski,
    # IEEE Trans. Automatic Control 30(6), 1985)
    F, G = zero_order_hold(A, B, 0.05)
    both = np.array([[1.0, 0.5]])
    K = dlqr(F, G, cost(np.ones((2, 2)), [1], (2, 1))).gain
    designs = recover(state_space(F, G, both, dt=0.05), K, NOISES, [0.0, 1e3, 1e4])
    gaps = [design.gap(FREQUENCIES).max() for design in designs]
    assert gaps[0] > 1.0 and gaps[1] < 0.01
    np.testing.assert_allclose(gaps[1] / gaps[2], 100.0, rtol=0.01)


def test_the_noise_enters_with_its_covariance():
    two = np.array([[0.0, 1.0], [1.0, 0.0]])
    plant = state_space(A, two, np.eye(2))
    K = lqr(A, two, cost([1, 1], [1, 1], (2, 2))).gain
    noises = (np.eye(2), np.eye(2))
    one = recover(plant, K, noises, [2.0], np.diag([1.0, 0.0]))[0]
    expected = recover(plant, K, (np.diag([1.0, 5.0]), np.eye(2)), [0.0])[0]
    np.testing.assert_allclose(one.estimator.gain, expected.estimator.gain)


def test_wrong_arguments_are_named():
    plant = state_space(A, B, C)
    with pytest.raises(ValueError, match='strengths: expected q >= 0'):
        recover(plant, regulator_gain(), NOISES, [-1.0])
    with pytest.raises(ValueError, match='input_noise: expected 1 numbers'):
        recover(plant, regulator_gain(), NOISES, [1.0], np.eye(2))
