# SPDX-License-Identifier: Apache-2.0
"""A regulator along a motion: where it aims, when it ends, and that its input never jumps."""

import numpy as np
import pytest

from kalman_ros.control.feedback import Feedback, Regulator
from kalman_ros.control.motion import Motion
from kalman_ros.control.moving_point import steady_input
from kalman_ros.core import Space
from kalman_ros.models.cart_pole import CartPole
from kalman_ros.models.diff_drive import diff_drive

SPACE = Space(('x', 'yaw'), ('m', 'rad'), angles=('yaw',))
STATES = np.array([[0.0, 3.0], [1.0, -3.0], [3.0, -2.0]])
INPUTS = np.array([[1.0], [2.0], [0.0]])
MOTION = Motion(SPACE, 0.1, STATES, INPUTS)
LAW = Feedback(np.array([[2.0, 1.0]]), np.empty((1, 0)), (), np.empty(0, dtype=complex))
REST = np.zeros(2), np.zeros(1)


def test_it_is_interpolated_the_short_way_and_held_beyond_its_ends():
    np.testing.assert_array_equal(MOTION.at(-1.0).state, STATES[0])
    np.testing.assert_array_equal(MOTION.at(9.0).state, STATES[2])
    np.testing.assert_array_equal(MOTION.at(0.1).state, STATES[1])
    middle = MOTION.at(0.05)
    assert middle.state[0] == pytest.approx(0.5)
    assert abs(middle.state[1]) == pytest.approx(np.pi, abs=1e-9)  # not by way of 0
    assert middle.input == 1.0
    assert MOTION.duration == pytest.approx(0.2)
    assert '0.2 s' in repr(MOTION) and 'yaw' in repr(MOTION)


def test_every_step_of_a_long_motion_is_met_exactly():
    states = np.arange(20_000.0)[:, np.newaxis]
    long = Motion(Space(('x',)), 0.01, states, states)
    assert all(long.at(k * 0.01).input == k for k in range(20_000))


def test_its_time_is_that_of_the_proposals():
    regulator = Regulator(SPACE, LAW, REST)
    regulator.follow_motion(MOTION)
    x = np.array([0.0, 3.0])
    np.testing.assert_allclose(regulator.propose(x, 0.3), 1.0)  # the first one is its start
    assert regulator.elapsed == 0.0
    regulator.propose(x, 0.1)
    np.testing.assert_array_equal(regulator.target[0], STATES[1])
    assert regulator.motion is MOTION
    regulator.propose(x, 0.1)
    assert regulator.motion is None
    np.testing.assert_array_equal(regulator.target[0], STATES[2])


def test_the_input_is_continuous_at_its_start_and_its_end():
    regulator = Regulator(SPACE, LAW, REST, blend=0.5)
    x = np.array([5.0, 0.0])
    u = regulator.propose(x, 0.1)
    regulator.applied(x, u, u, 0.1)
    regulator.follow_motion(MOTION)
    np.testing.assert_allclose(regulator.propose(x, 0.0), u)
    u = regulator.propose(x, 0.1)
    regulator.applied(x, u, u, 0.1)
    regulator.hold(*REST)
    assert regulator.motion is None
    np.testing.assert_allclose(regulator.propose(x, 0.0), u)


def test_its_gains_are_used_while_it_lasts():
    gains = np.array([[[1.0, 0.0]], [[3.0, 0.0]], [[7.0, 0.0]]])
    regulator = Regulator(SPACE, LAW, REST)
    regulator.follow_motion(Motion(SPACE, 0.1, STATES, INPUTS, gains))
    x = np.array([2.0, 3.0])
    np.testing.assert_allclose(regulator.propose(x, 0.1), 1.0 - 1.0 * 2.0)
    np.testing.assert_allclose(regulator.propose(x, 0.1), 2.0 - 3.0 * 1.0)
    regulator.adopt(LAW, 0.0)
    regulator.propose(x, 0.1)
    np.testing.assert_allclose(regulator.propose(x, 0.1), 0.0 - 7.0 * -1.0)
    regulator.adopt(LAW, 0.0)  # at rest, other gains of the law count at once
    error = SPACE.subtract(x, STATES[2])
    np.testing.assert_allclose(regulator.propose(x, 0.1), -LAW.gain @ error)


def test_the_input_of_a_moving_state_keeps_it_at_its_rate():
    robot = diff_drive(command_time=0.2)
    x = np.array([1.0, 2.0, 0.8, 0.5, 0.3])
    u, missed = steady_input(robot, x, np.zeros(5))
    np.testing.assert_allclose(u, [0.8, 0.3])
    assert not missed.any()
    u, _ = steady_input(robot, x, np.array([9.0, 9.0, 0.1, 9.0, -0.2]))
    np.testing.assert_allclose(u, [0.8 + 0.2 * 0.1, 0.3 - 0.2 * 0.2])
    pole = CartPole()
    _, missed = steady_input(pole, np.array([0.0, 0.5, 0.3, 0.0]), np.zeros(4))
    assert np.abs(missed).max() > 0.1
