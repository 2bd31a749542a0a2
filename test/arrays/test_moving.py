# SPDX-License-Identifier: Apache-2.0
"""`kr.motion`: paths and values, followed in simulations, and what is refused."""

import numpy as np
import pytest
from thorough import mostly_thorough, thorough

import kalman_ros as kr

pytestmark = pytest.mark.slow

ROBOT = 'diff_drive', {'model_parameters.command_time': 0.2, 'initial_state': [0.0] * 5}


@pytest.mark.thorough
def test_a_path_is_followed_with_the_estimate_of_noisy_sensors():
    motion = kr.motion(*ROBOT, path=[[0, 0], [2, 0], [2, 2]])
    run = kr.simulate(*ROBOT, seconds=motion.duration + 1.0, reference=motion)
    steps = len(motion.states)
    off = run.scenario.model.state.subtract(run.estimate[:steps], motion.states)
    assert np.abs(off[:, :2]).max() < 0.05
    np.testing.assert_allclose(run.truth[-1, :2], [2.0, 2.0], atol=0.15)
    assert 'motion of 10' in repr(motion)


def test_a_cart_goes_where_its_values_say_while_its_pole_stands():
    t, cart = np.linspace(0.0, 4.0, 9), ('cart_pole', {'initial_state': [0.0] * 4})
    motion = kr.motion(*cart, values={'x': np.sin(np.pi * t / 8.0) ** 2}, times=t)
    run = kr.simulate(*cart, seconds=5.0, reference=motion)
    plain = kr.simulate(*cart, seconds=5.0, reference=lambda time: {
        'x': np.sin(np.pi * min(time, 4.0) / 8.0) ** 2})  # fmt: skip
    steps = len(motion.states)
    follows, lags = (np.abs(r.truth[:steps, 0] - motion.states[:, 0]).max() for r in (run, plain))
    assert follows < 0.5 * lags
    assert np.abs(run.truth[:, 2]).max() < 0.3


def test_a_robot_goes_in_any_direction_by_values_of_its_place():
    for x, y in ((0.0, 2.0), (-1.0, -1.0), (-2.0, 0.0)):
        values = {'x': [0.0, x / 2, x], 'y': [0.0, y / 2, y]}
        motion = kr.motion(*ROBOT, values=values, times=[0.0, 3.0, 6.0])
        assert motion.states[:, 2].min() > -1e-3
        heading = np.arctan2(y, x)
        off = motion.space.subtract(motion.states, np.array([0, 0, 0, heading, 0]))[:, 3]
        assert np.abs(off).max() < 1e-3


@pytest.mark.parametrize(
    'arguments',
    [
        ('cart_pole', {}, {'values': {'x': [0, 1]}, 'times': [0, 3]}),
        ('cart_pole', {}, {'end': {'x': 1.0}, 'seconds': 2.0}),
        thorough(('submersible', {}, {'values': {'x': [0, 1, 0]}, 'times': [0, 2, 4]})),
        (*ROBOT, {'path': [[0, 0], [2, 0], [2, 2]]}),
    ],
)
def test_a_motion_is_one_of_the_model_to_its_last_step(arguments):
    name, overrides, wanted = arguments
    motion = kr.motion(name, overrides, **wanted)
    model = kr.load(name, overrides).model
    reached = model.step(motion.states[:-1], motion.inputs[:-1], motion.dt)
    gap = motion.space.subtract(reached, motion.states[1:])
    assert np.abs(gap).max() < 2e-3


def test_many_runs_follow_it_as_one_does():
    motion = kr.motion(*ROBOT, path=[[0, 0], [1, 0]])
    many = kr.monte_carlo(*ROBOT, seconds=motion.duration, runs=4, reference=motion)
    assert 'ANEES' in repr(many)
    regulator = kr.Regulator(*ROBOT, reference=motion)
    np.testing.assert_allclose(regulator.step(motion.states[0]), motion.inputs[0], atol=1e-6)
    np.testing.assert_allclose(regulator.step(motion.states[1]), motion.inputs[1], atol=1e-6)


def test_a_reference_that_moves_is_no_error():
    def circle(t):
        return {'x': np.sin(t), 'v_x': np.cos(t), 'y': np.cos(t), 'v_y': -np.sin(t)}

    exact = {'position.noise': [1e-6] * 2, 'velocity.noise': [1e-6] * 2,
             'model_parameters.force_noise': 1e-12}  # fmt: skip
    run = kr.simulate('mass_spring_damper_2d', exact, seconds=12.0, reference=circle)
    late = run.time > 8.0
    np.testing.assert_allclose(run.truth[late, 0], np.sin(run.time[late]), atol=0.01)
    np.testing.assert_allclose(run.truth[late, 2], np.cos(run.time[late]), atol=0.01)


@pytest.mark.thorough
@pytest.mark.parametrize('seeds', [range(5), thorough(range(100))])
def test_the_pole_swings_up_and_stands(seeds):
    hanging = [0.0, 0.0, np.pi, 0.0]
    cart = 'cart_pole', {'initial_state': hanging, 'initial_estimate': hanging,
                         'initial_std': [0.01] * 4}  # fmt: skip
    motion = kr.motion(*cart, start={'theta': np.pi}, seconds=2.0)
    assert abs(motion.states[0, 2]) == pytest.approx(np.pi, abs=1e-4)
    for seed in seeds:
        run = kr.simulate(*cart, seconds=4.0, seed=seed, reference=motion, input_limit=15.0)
        assert np.abs(run.truth[-50:, 2]).max() < 0.1, seed


@pytest.mark.parametrize('seconds', mostly_thorough([1.2, 1.5, 2.0, 2.5], 1.2))
def test_it_is_found_for_other_durations(seconds):
    motion = kr.motion('cart_pole', start={'theta': np.pi}, seconds=seconds)
    x = motion.states[:-2]
    reached = kr.load('cart_pole').model.step(x, motion.inputs[:-2], motion.dt)
    gap = motion.space.subtract(reached, motion.states[1:-1])
    assert np.abs(gap).max() < 1e-6


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        ({}, r'^path: expected a path, or values with their times'),
        ({'path': [[0, 0]], 'values': {'x': [0]}}, r'^path: expected a path, or values'),
        ({'path': [0, 1]}, r'^path: expected points of 2 or 3 numbers, got an array \(2,\)'),
        ({'path': [[0, 0]]}, r'^path: expected 2 to 1000000 points, got 1'),
        ({'path': [[0, 0], [1, 0]], 'speed': 0}, r'^speed: expected a positive number'),
        ({'path': [[0, 0], [1e300, 0]]}, r'^path: expected positions whose distances'),
        ({'path': [[0, 0], [1, 0]], 'tolerance': -1}, r'^tolerance: .* at least 0, got -1'),
        ({'path': [[0, 0], [1, 0]], 'tolerance': np.nan}, r'^tolerance: expected a finite'),
        ({'path': [[0, 0], [1, 0]], 'input_limit': 0.1}, r'^path: it needs v of .* at .* s'),
        ({'seconds': 0, 'end': {}}, r'^seconds: expected a positive number'),
        ({'seconds': 1}, r'^seconds: expected a start or an end'),
        ({'path': [[0, 0], [1, 0]], 'end': {}}, r'^start: expected the seconds'),
        ({'seconds': 1, 'start': 3}, r'^start: expected values by name, got int'),
        ({'seconds': 1, 'end': 'abc'}, r'^end: expected values by name, got str'),
        ({'seconds': 1, 'end': {1: 2}}, r"^end: expected names among .*, got '1'"),
        ({'values': [], 'times': [0, 1]}, r'^values: expected values by name, got list'),
        ({'seconds': 1, 'end': {'z': 1}}, r'^end: expected names'),
        ({'seconds': 1, 'end': {'v': 1.0}}, r'^start and end: at the end no .*: x changes'),
        ({'seconds': 1, 'end': {'x': np.nan}}, r'^start and end: expected finite states'),
        ({'seconds': 1e9, 'end': {}}, r'^start and end: expected at most 60000'),
        ({'values': {'x': [0, 1]}}, r'^values: expected their times'),
        ({'values': {'x': [0, 1]}, 'times': [0]}, r'^values\.x: expected 1 numbers'),
        ({'values': {'z': [0, 1]}, 'times': [0, 1]}, r'^values: expected names among .* got .z.'),
        ({'values': {}, 'times': [0, 1]}, r'^values: expected the values of a state'),
        (
            {'values': {'x': [0, 1]}, 'times': [0, 1], 'velocities': {'y': [0, 0]}},
            r'^velocities: expected those of x',
        ),
        (
            {'values': {'x': [0, 1]}, 'times': [0, 1], 'velocities': {'x': [0, float('nan')]}},
            r'^velocities\.x: expected finite numbers',
        ),
        ({'values': {'x': [0, 1]}, 'times': [0, 'b']}, r'^times: expected real numbers'),
        ({'start': {'x': 'a'}, 'seconds': 2.0}, r"^start\.x: expected a number, got 'a'"),
        ({'path': [[0, 0], [2, 0]], 'speed': True}, '^speed: expected a number, got True'),
    ],
)
def test_what_is_no_motion_is_refused_by_name(arguments, reason):
    with pytest.raises(ValueError, match=reason):
        kr.motion(*ROBOT, **arguments)


def test_a_motion_of_another_model_or_rate_is_refused():
    motion = kr.motion(*ROBOT, path=[[0, 0], [1, 0]])
    with pytest.raises(ValueError, match=r'^reference: expected a motion of \(x, v, theta'):
        kr.simulate('cart_pole', reference=motion)
    with pytest.raises(ValueError, match=r'^reference: expected a motion .* steps of 0.02 s'):
        kr.simulate(ROBOT[0], {**ROBOT[1], 'rate': 50.0}, reference=motion)
