# SPDX-License-Identifier: Apache-2.0
"""A regulator along a motion: where it aims, when it ends, and that its input never jumps."""

from dataclasses import replace

import numpy as np
import pytest

from kalman_ros.control.feedback import Feedback, Regulator
from kalman_ros.control.motion import Differences, Motion
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


def changing(motion):
    """Return the motion with gains and differences that are others at each step."""
    k = np.arange(1.0, len(motion.states) + 1.0)[:, np.newaxis, np.newaxis]
    differences = Differences(k * np.eye(2), k * np.ones((2, 1)), k * np.ones((1, 1)))
    return replace(motion, gains=k * np.array([[2.0, 3.0]]), differences=differences)


def assert_steps(motion, steps):
    """Assert that these steps of `MOTION` are all of a motion, with what belongs to them."""
    whole = changing(MOTION)
    np.testing.assert_array_equal(motion.states, STATES[steps])
    np.testing.assert_array_equal(motion.inputs, INPUTS[steps])
    np.testing.assert_array_equal(motion.gains, whole.gains[steps])
    for mine, theirs in zip(motion.differences, whole.differences):
        np.testing.assert_array_equal(mine, theirs[steps])


@pytest.mark.parametrize(
    ('seconds', 'count', 'steps'),
    [
        (0.0, 2, [0, 1, 2]),
        (-9.0, 1, [0, 1]),
        (0.0999, 1, [0, 1]),
        (0.1 - 1e-9, 1, [1, 2]),
        (0.15, 3, [1, 2, 2, 2]),
        (9.0, 2, [2, 2, 2]),
    ],
)
def test_what_is_ahead_rests_after_the_end(seconds, count, steps):
    assert_steps(changing(MOTION).ahead(seconds, count), steps)
    assert MOTION.ahead(seconds, count).gains is None


@pytest.mark.parametrize(
    ('start', 'end', 'steps'),
    [
        (0.0, 0.2, [0, 1, 2]),
        (-1.0, 9.0, [0, 1, 2]),
        (0.15, 0.2 - 1e-9, [1, 2]),
        (0.1 - 1e-9, 0.19, [1]),
        (0.15, 0.05, [1]),
        (9.0, 9.0, [2]),
    ],
)
def test_a_part_begins_at_the_step_before_its_start(start, end, steps):
    assert_steps(changing(MOTION).part(start, end), steps)
    assert MOTION.part(start, end).differences is None


def test_two_parts_that_meet_are_one_motion():
    whole = changing(MOTION)
    first, second = whole.part(0.0, 0.1), whole.part(0.1, 0.2)
    assert_steps(first.then(second), [0, 1, 2])
    plain = first.then(replace(second, gains=None, differences=None))
    np.testing.assert_array_equal(plain.states, STATES)
    assert plain.gains is plain.differences is None
    plain = replace(first, gains=None, differences=None).then(second)
    assert plain.gains is plain.differences is None


def test_the_rate_of_a_step_leads_to_the_next_and_its_input_is_the_one_before():
    for seconds, step, before in ((-1.0, 0, 0), (0.0, 0, 0), (0.1 - 1e-9, 1, 0), (0.19, 1, 0)):
        state, rate, u = MOTION.moving(seconds)
        np.testing.assert_array_equal(state, STATES[step])
        np.testing.assert_allclose(rate, SPACE.subtract(STATES[step + 1], STATES[step]) / 0.1)
        np.testing.assert_array_equal(u, INPUTS[before])
    for seconds in (0.2, 9.0):
        state, rate, u = MOTION.moving(seconds)
        np.testing.assert_array_equal(state, STATES[2])
        np.testing.assert_array_equal(rate, [0.0, 0.0])
        np.testing.assert_array_equal(u, INPUTS[2])
    long = Motion(SPACE, 0.1, np.vstack((STATES, STATES)), np.arange(6.0)[:, np.newaxis])
    np.testing.assert_array_equal(long.moving(0.31)[2], [2.0])
    np.testing.assert_allclose(MOTION.time, [0.0, 0.1, 0.2])


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
