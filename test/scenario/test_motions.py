# SPDX-License-Identifier: Apache-2.0
"""Motions of scenarios: which are followed, which are refused, and with what gains."""

from dataclasses import replace
from functools import partial
from math import inf

import numpy as np
import pytest
from thorough import thorough

from kalman_ros.control.limiter import Limits, limits_of
from kalman_ros.core import DesignError
from kalman_ros.scenario import build
from kalman_ros.scenario.motions import _swerving, motion_of, moving_point
from kalman_ros.scenario.reference_motions import Beginning, _begun, along_path, in_time
from kalman_ros.scenario.regulator import feedback, steered

pytestmark = pytest.mark.slow

ROBOT = {'model': 'diff_drive', 'model_parameters.command_time': 0.2}
CORNER = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0]])
LINE = CORNER[:2]
#: What makes the place across a robot at rest grow.
UP = np.array([0.0, 1.0, 0.0, 0.0, 0.0])
#: No input moves its first state.
STUCK = {'model_parameters.A': [0.0, 0.0, 0.0, -1.0], 'model_parameters.B': [0.0, 1.0]}


def robot(**more):
    return build({**ROBOT, **more})


def test_a_path_is_passed_from_rest_to_rest():
    scenario = robot()
    motion = motion_of(scenario, along_path(scenario, CORNER, 0.5, 0.5))
    np.testing.assert_allclose(motion.states[-1], [2.0, 2.0, 0.0, np.pi / 2, 0.0], atol=1e-2)
    assert not motion.inputs[-1].any()
    np.testing.assert_allclose(motion.states[0], 0.0, atol=1e-3)
    assert motion.states[:, 2].max() < 0.51
    assert motion.gains.shape == (len(motion.states), 2, 5)


def test_every_model_with_a_position_and_an_input_follows_a_path():
    for values in (
        {'model': 'mass_spring_damper_2d'},
        {'model': 'robot_2d', 'model_parameters.command_time': 0.3},
        {'model': 'submersible'},
        {'model': 'cart_pole'},
    ):
        scenario = build(values)
        motion = motion_of(scenario, along_path(scenario, LINE, 0.5, 0.5))
        places = [scenario.model.state.names.index('x')]
        np.testing.assert_allclose(motion.states[-1, places], 2.0, atol=1e-9)
        reached = scenario.model.step(motion.states[:-2], motion.inputs[:-2], motion.dt)
        gap = scenario.model.state.subtract(reached, motion.states[1:-1])
        assert np.abs(gap).max() < 1e-6


def test_a_robot_that_moves_sideways_keeps_the_headings_of_its_path():
    scenario = build({'model': 'robot_2d', 'model_parameters.command_time': 0.3})
    yaw = np.array([0.0, 1.0])
    reference = along_path(scenario, LINE, 0.5, 0.5, yaw)
    motion = motion_of(scenario, reference)
    np.testing.assert_allclose(motion.states[[0, -1], 2], yaw, atol=0.02)
    assert np.abs(motion.states[:, 1]).max() < 0.01


def test_a_path_has_to_lead_somewhere_in_the_space_of_the_model():
    submersible = build({'model': 'submersible'})
    aside = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    with pytest.raises(ValueError, match='points that differ in x, z, the position'):
        along_path(submersible, aside, 0.5, 0.5)
    with pytest.raises(ValueError, match='two different points or more, got 2, all the same'):
        along_path(submersible, aside[:1].repeat(2, axis=0), 0.5, 0.5)


def test_times_of_a_path_count_where_they_are_given():
    scenario = robot()
    reference = along_path(scenario, LINE, 0.5, 0.5, times=np.array([0.0, 8.0]))
    motion = motion_of(scenario, reference)
    assert motion.duration == pytest.approx(8.0)
    np.testing.assert_allclose(motion.at(4.0).state[0], 1.0, atol=0.01)


def test_a_linear_model_keeps_the_gains_of_its_law_and_so_do_other_laws():
    spring = build({'model': 'mass_spring_damper_2d'})
    assert motion_of(spring, along_path(spring, LINE, 0.5, 0.5)).gains is None
    placed = build({'model': 'cart_pole', 'law': 'placement', 'regulator_poles': [-2.0, -3.0]})
    assert motion_of(placed, along_path(placed, LINE, 0.5, 0.5)).gains is None


def test_at_its_end_the_regulator_is_the_law_to_the_last_bit():
    scenario = build({'model': 'cart_pole'})
    motion = motion_of(scenario, along_path(scenario, LINE, 0.5, 0.5))
    np.testing.assert_array_equal(motion.gains[-1], feedback(scenario).gain)
    rest = scenario.model.equilibrium
    np.testing.assert_array_equal(motion.states[-1, 1:], rest.state[1:])


def test_what_no_input_follows_is_refused_with_state_and_time():
    scenario = build({'model': 'cart_pole'})
    times = np.array([0.0, 1.0, 2.0])
    leaning = np.array([[0.0, 0.0], [0.0, 0.4], [0.0, 0.0]])
    lean = in_time(scenario, [0, 2], times, leaning)
    with pytest.raises(ValueError, match=r'theta is \S+ rad away|fails at \w+, \S+ s'):
        motion_of(scenario, lean)
    jump = in_time(scenario, [0, 1], times, np.array([[0.0, 1.0], [0.0, 1.0], [0.0, 0.0]]))
    with pytest.raises(
        ValueError, match='no input follows it|does not (begin|end) where|fails at'
    ):
        motion_of(scenario, jump)


@pytest.mark.slow
@pytest.mark.parametrize('side', [thorough(1.0), -1.0])
def test_a_turn_to_either_side_names_the_limit_that_is_given(side):
    reference = along_path(robot(), CORNER * [1.0, side, 1.0], 0.5, 0.5)
    largest = limits_of(2, {'input_limit': [np.inf, 1.0]})
    with pytest.raises(ValueError, match=rf'beyond the input_limit of {side:g}; a slower motion'):
        motion_of(robot(), reference, largest)


@pytest.mark.slow
def test_a_robot_that_cannot_reverse_follows_a_path_and_brakes_gently():
    forward = limits_of(2, {'input_limit': [1.5, 6.0], 'input_lower_limit': [0.0, -np.inf]})
    motion = motion_of(robot(), along_path(robot(), CORNER, 0.5, 0.5), forward)
    assert -0.05 < motion.inputs[:, 0].min() < 0.0
    hasty = along_path(robot(), CORNER[:2], 0.2, 0.5)
    with pytest.raises(ValueError, match=r'input_lower_limit of 0; a smaller acceleration needs'):
        motion_of(robot(), hasty, forward)
    slow_reverse = limits_of(2, {'input_limit': [1.5, 6.0], 'input_lower_limit': [-0.02, -np.inf]})
    with pytest.raises(ValueError, match=r'input_lower_limit of -0.02; a slower motion, or wider'):
        motion_of(robot(), hasty, slow_reverse)


@pytest.mark.parametrize(('factor', 'refused'), [thorough(1.01, False), thorough(0.99, True)])
def test_inputs_beyond_their_limits_are_refused_with_the_time(factor, refused):
    scenario = robot()
    reference = along_path(scenario, CORNER, 0.5, 0.5)
    inputs = motion_of(scenario, reference).inputs
    rate = np.abs(np.diff(inputs[:-1], axis=0)).max(axis=0) * scenario.rate
    none = np.full(2, np.inf)
    for given, name in (
        (Limits(-none, factor * inputs.max(axis=0), none), 'input_limit'),
        (Limits(-none, none, factor * rate), 'input_rate_limit'),
    ):
        if refused:
            with pytest.raises(ValueError, match=rf'at \S+ s, beyond the {name} of'):
                motion_of(scenario, reference, given)
        else:
            motion_of(scenario, reference, given)


@pytest.mark.thorough
def test_a_motion_may_be_as_far_away_as_the_tolerance_says():
    scenario = robot()
    reference = along_path(scenario, LINE, 0.5, 0.5)
    bent = reference.values.copy()
    bent[400:, 1] += 1.0  # a jump to the side; a tenth of the extent is 0.2
    off = type(reference)(reference.dt, reference.coordinates, bent, reference.hints,
                          reference.start, None)  # fmt: skip
    away = np.abs(motion_of(scenario, off, tolerance=1.0).states[:, :2] - bent).max()
    assert away > 0.2
    motion_of(scenario, off, tolerance=away * 1.01)
    with pytest.raises(ValueError, match='y is .* away'):
        motion_of(scenario, off, tolerance=away * 0.99)


@pytest.mark.parametrize(
    ('times', 'values', 'reason'),
    [
        ([0.0], [[1.0]], 'two points or more, got 1'),
        ([0.0, 1.0, 1.0], [[1.0]] * 3, 'increasing times, got 1 s after 1 s'),
        ([0.0, 1.0, 0.5], [[1.0]] * 3, 'increasing times, got 0.5 s after 1 s'),
        ([0.0, np.nan], [[1.0]] * 2, 'finite times'),
        ([0.0, 1.0], [[1.0], [np.inf]], 'finite numbers'),
        ([0.0, 601.0], [[1.0]] * 2, 'at most 60000 steps, 600 s, got 601 s'),
    ],
)
def test_what_is_no_motion_is_refused(times, values, reason):
    with pytest.raises(ValueError, match=reason):
        in_time(robot(), [0], np.array(times), np.array(values))


def test_paths_need_a_position_and_points():
    scenario = robot()
    for points, reason in (
        (CORNER[:1], '2 to 1000000 points, got 1'),
        (np.array([[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0]]), 'finite positions'),
    ):
        with pytest.raises(ValueError, match=reason):
            along_path(scenario, points, 0.5, 0.5)
    with pytest.raises(ValueError, match='has no position'):
        along_path(build({'model': 'dc_motor'}), LINE, 0.5, 0.5)
    still = build({'model': 'diff_drive'})
    with pytest.raises(DesignError, match='no input'):
        motion_of(still, along_path(still, LINE, 0.5, 0.5))


def test_a_robot_on_wheels_has_no_gain_at_rest():
    scenario = robot()
    assert steered(scenario)
    assert not feedback(scenario).gain.any()
    assert not steered(build({'model': 'cart_pole'}))
    with pytest.raises(DesignError):  # of a linear model no motion helps
        feedback(build({'model': 'linear', **STUCK}))


def test_a_mode_that_grows_and_that_no_input_moves_is_refused(monkeypatch):
    scenario = robot()
    model = scenario.model
    monkeypatch.setattr(
        model, 'derivative', lambda x, u: type(model).derivative(model, x, u) + 0.1 * x * UP
    )
    A = type(model).state_jacobian
    monkeypatch.setattr(model, 'state_jacobian', lambda x, u: A(model, x, u) + 0.1 * np.diag(UP))
    assert not steered(scenario)
    with pytest.raises(DesignError):
        feedback(scenario)


def test_a_moving_set_point_moves_by_its_velocity_and_then_rests():
    scenario = build({'model': 'mass_spring_damper_2d'})
    motion = moving_point(scenario, np.array([1.0, 0.4, 0.0, 0.0]), None, 0.5)
    np.testing.assert_allclose(motion.states[-2], [1.2, 0.4, 0.0, 0.0], atol=0.01)
    np.testing.assert_allclose(motion.states[-1], [1.2, 0.0, 0.0, 0.0], atol=0.01)
    rate = np.array([9.0, -0.4, 0.0, 0.0])
    braking = moving_point(scenario, np.array([1.0, 0.4, 0.0, 0.0]), rate, 0.5, 0.5)
    assert braking.states[-2, 1] == pytest.approx(0.2, abs=0.02)
    pole = build({'model': 'cart_pole'})
    with pytest.raises(ValueError, match='no input keeps'):
        moving_point(pole, np.array([0.0, 0.0, 0.3, 0.0]), None, 0.5)


def test_a_moving_robot_on_wheels_is_steered_with_the_gain_of_its_speed():
    scenario = robot()
    moving = moving_point(scenario, np.array([0.0, 0.0, 0.5, 0.0, 0.0]), None, 0.5)
    assert moving.gains[0, 1, 1] > 0.1  # to the left of the path it turns right
    assert not moving.gains[-1].any()
    still = moving_point(scenario, np.array([0.0, 0.0, 0.0, 0.0, 0.2]), None, 0.5)
    assert not still.gains.any()


def cruising(speed=0.5):
    """Return a robot on its way along the x axis, after two metres."""
    scenario = robot()
    path = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    motion = motion_of(scenario, along_path(scenario, path, speed, 0.5))
    return scenario, motion, Beginning(*motion.moving(4.0)), motion.at(4.0).input


@pytest.mark.parametrize(
    ('path', 'longest'),
    [
        ([[0.0, 0.0], [5.0, 0.0]], 8.0),  # the same
        thorough([[1.0, 0.05], [5.0, 0.05]], 8.0),  # beside it
        thorough([[1.75, 0.0], [-1.0, 0.0]], 14.0),  # back
        thorough([[1.75, 0.0], [1.75, 2.0]], 12.0),  # at right angles
        ([[1.0, 0.0], [1.3, 0.0]], 12.0),  # ends behind the robot
        thorough([[1.75, 0.0], [1.8, 0.0]], 9.0),  # ends too soon
    ],
)
def test_a_new_path_is_planned_from_where_the_robot_is_as_fast_as_it_is(path, longest):
    scenario, _, begin, before = cruising()
    points = np.column_stack((np.array(path), np.zeros(len(path))))
    reference = along_path(scenario, points, 0.5, 0.5, beginning=begin)
    first, second = reference.values[:2]
    np.testing.assert_allclose(first, begin.state[:2], atol=1e-9)
    np.testing.assert_allclose((second - first) * scenario.rate, begin.rate[:2], atol=0.01)
    motion = motion_of(scenario, reference, limits_of(2, {'input_limit': [1.0, 3.0]}))
    np.testing.assert_allclose(motion.states[0], begin.state)
    assert np.abs(motion.inputs[0] - before)[0] < 0.25
    assert np.abs(motion.inputs[:, 0]).max() < 0.85
    assert motion.duration < longest
    np.testing.assert_allclose(motion.states[-1, :2], path[-1], atol=1e-6)


@pytest.mark.thorough
def test_a_path_that_is_planned_again_while_it_speeds_up_or_brakes_needs_no_other_input():
    scenario, motion, _, _ = cruising()
    path = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    for seconds in (0.1, 0.4, 0.8, 10.2, 10.6):
        begin = Beginning(*motion.moving(seconds))
        again = motion_of(scenario, along_path(scenario, path, 0.5, 0.5, beginning=begin))
        off = np.abs(again.inputs[:30] - motion.inputs[round(seconds * 100) :][:30])
        assert off[:, 0].max() < 0.2, seconds


def test_what_does_not_end_at_rest_is_refused():
    scenario = build({'model': 'cart_pole'})
    times, x = np.array([0.0, 2.0]), np.array([[0.0], [0.3]])
    with pytest.raises(ValueError, match=r'it does not end at rest: no input holds x 0\.3'):
        in_time(scenario, [0], times, x, np.array([[0.0], [0.5]]))
    with pytest.raises(ValueError, match=r'it does not end at rest: no input holds v 0\.3'):
        in_time(scenario, [1], times, x)


def test_a_motion_that_begins_elsewhere_joins_smoothly():
    """At the place, with the velocity and no acceleration; after a second it is as before."""
    dt = 0.001
    time = np.arange(0.0, 2.0, dt)[:, np.newaxis]
    before = np.hstack((0.3 * time, np.sin(time)))
    at, velocity = np.array([0.2, -0.1]), np.array([-0.4, 0.7])
    moved = _begun(before, at, velocity, dt)
    np.testing.assert_allclose(moved[0], at, atol=1e-12)
    difference = moved - before
    speed = np.gradient(difference, dt, axis=0)
    acceleration = np.gradient(speed, dt, axis=0)
    np.testing.assert_allclose(speed[1], velocity - [0.3, 1.0], atol=2e-3)
    np.testing.assert_allclose(acceleration[3], 0.0, atol=0.1)
    # a polynomial that ends with its slope and curvature at zero
    np.testing.assert_allclose(difference[999], 0.0, atol=1e-5)
    np.testing.assert_allclose(speed[999:1001], 0.0, atol=1e-4)
    np.testing.assert_allclose(acceleration[996], 0.0, atol=0.1)
    np.testing.assert_array_equal(moved[1000:], before[1000:])


def test_a_search_that_swerves_begins_and_ends_as_the_straight_one():
    """Its middle is to one side, and the coordinates leave in turns to either side."""
    scenario = robot()
    guess = np.tile(np.arange(5.0) - 2.0, (21, 1))
    reference = replace(along_path(scenario, LINE, 0.5, 0.5), guess=guess)
    for amount in (0.3, -0.3):
        found = _swerving(scenario, reference, amount).guess - guess
        np.testing.assert_allclose(found[[0, -1]], 0.0, atol=1e-12)
        np.testing.assert_allclose(found[10], amount * np.array([1.0, -1.0, 1.0, -1.0, 1.0]))
        np.testing.assert_allclose(found, found[::-1], atol=1e-12)


def within(**limits):
    return robot(
        law='mpc', initial_state=[0.0] * 5, **{f'state_limit.{n}': p for n, p in limits.items()}
    )


@pytest.mark.parametrize(
    ('limits', 'slower'),
    [
        ({}, 1.0),
        ({'v': [-0.6, 0.6]}, 1.0),
        ({'v': [-0.3, 0.3]}, 0.57),
        ({'v': [-inf, 0.3], 'y': [-inf, 3.0]}, 0.57),
        ({'omega': [-0.4, 0.4]}, None),
    ],
)
def test_a_path_is_passed_as_slowly_as_the_limits_of_states_need_it(limits, slower):
    built = within(**limits)
    motion = motion_of(built, partial(along_path, built, CORNER, 0.5, 0.5))
    fast = motion_of(robot(), along_path(robot(), CORNER, 0.5, 0.5))
    for name, (low, high) in limits.items():
        values = motion.states[:, built.model.state.names.index(name)]
        slack = 0.02 * np.abs(values).max()
        assert low - slack <= values.min() and values.max() <= high + slack
    if slower is None:
        assert motion.duration > fast.duration
    else:
        peaks = [each.states[:, 2].max() for each in (motion, fast)]
        assert peaks[0] == pytest.approx(slower * peaks[1], rel=0.05)
    np.testing.assert_allclose(motion.states[-1], fast.states[-1], atol=1e-2)


@pytest.mark.parametrize(
    ('limits', 'named'),
    [
        ({'x': [-0.5, 1.5]}, r'x is 2\.?\d* m at .* s, beyond its state_limit of 1.5'),
        ({'x': [0.2, 2.5]}, r'x is .* m at .* s, beyond its state_limit of 0.2'),
        ({'v': [0.2, 0.6]}, r'v is .* m/s at .* s, beyond its state_limit of 0.2'),
    ],
)
def test_a_path_that_no_speed_keeps_within_the_limits_of_states_is_refused(limits, named):
    built = within(**limits)
    with pytest.raises(ValueError, match=named):
        motion_of(built, partial(along_path, built, CORNER, 0.5, 0.5))


def test_values_in_time_beyond_a_limit_of_a_state_are_refused():
    built = within(v=[-0.3, 0.3])
    with pytest.raises(
        ValueError, match=r'v is 0\.5\d* m/s at .* beyond its state_limit of 0.3; a'
    ):
        motion_of(built, along_path(built, CORNER, 0.5, 0.5))
