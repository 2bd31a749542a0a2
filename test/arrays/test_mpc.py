# SPDX-License-Identifier: Apache-2.0
"""`kr.mpc` and ``law: mpc`` in simulations: limits that are kept, and what is refused."""

import numpy as np
import pytest
from thorough import mostly_thorough

import kalman_ros as kr
from kalman_ros.core import OperatingPoint, Space

pytestmark = pytest.mark.slow

LINEAR = ['mass_spring_damper', 'mass_spring_damper_2d', 'dc_motor', 'submersible']
MASS = [[0.0, 1.0], [0.0, 0.0]], [0.0, 1.0], [1.0, 0.1], 0.1


def start(state):
    return {'initial_state': state, 'initial_estimate': state}


@pytest.mark.parametrize('name', [*LINEAR, 'cart_pole'])
def test_without_limits_it_is_the_regulator_to_the_last_bit(name):
    runs = [kr.simulate(name, {'law': law}, seconds=1.0, seed=4) for law in ('lqr', 'mpc')]
    np.testing.assert_array_equal(runs[0].input, runs[1].input)
    np.testing.assert_array_equal(runs[0].truth, runs[1].truth)


def test_a_pole_stands_and_its_cart_stays_on_the_track_where_the_cut_off_regulator_loses_it():
    begun = start([0.8, 0.0, 0.0, 0.0])
    limits = {'state_limit.x': [-1.0, 1.0], 'state_limit.theta': [-0.4, 0.4]}
    kept = kr.simulate('cart_pole', {**begun, 'law': 'mpc', **limits}, seconds=4.0, input_limit=10)
    lost = kr.simulate('cart_pole', {**begun, 'law': 'lqr'}, seconds=4.0, input_limit=10)
    assert np.abs(kept.truth[:, 0]).max() < 1.0 and np.abs(kept.truth[:, 2]).max() < 0.5
    assert np.abs(kept.truth[-1, [0, 2]]).max() < 0.1
    assert np.abs(kept.input).max() <= 10.0
    assert np.abs(lost.truth[:, 2]).max() > 1.5


@pytest.mark.thorough
def test_a_robot_on_wheels_keeps_limits_of_its_states_along_a_path():
    robot = {'model_parameters.command_time': 0.2, 'initial_state': [0.0] * 5, 'law': 'mpc',
             'horizon': 0.6, 'state_limit.omega': [-1.5, 1.5]}  # fmt: skip
    motion = kr.motion('diff_drive', robot, path=[[0, 0], [1, 0], [1, 1]])
    assert np.abs(motion.states[:, 4]).max() > 2.0
    run = kr.simulate('diff_drive', robot, seconds=motion.duration + 0.5, reference=motion)
    assert np.abs(run.estimate[:, 4]).max() < 1.6
    np.testing.assert_allclose(run.truth[-1, :2], [1.0, 1.0], atol=0.3)


def test_many_runs_are_each_as_alone():
    over = {**start([0.5, 0.0]), 'law': 'mpc'}
    many = kr.monte_carlo('mass_spring_damper', over, runs=3, seconds=0.5, seed=5, input_limit=0.2)
    seed = many.seeds[1]
    one = kr.simulate('mass_spring_damper', over, seconds=0.5, seed=seed, input_limit=0.2)
    np.testing.assert_allclose(many.run(1).truth, one.truth, atol=1e-9)


def cost(scenario, run):
    x, u = run.truth, run.input
    both = np.einsum('ki,ij,kj', x, scenario.state_cost, x)
    return both + np.einsum('ki,ij,kj', u, scenario.input_cost, u)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ('name', 'limits', 'most', 'least'),
    [
        ('mass_spring_damper', {}, 0.5, 95),
        ('cart_pole', {'state_limit.theta': [-0.3, 0.3]}, 8.0, 95),
    ],
)
def test_it_costs_less_than_the_cut_off_regulator(name, limits, most, least):
    rng, lower, scenario = np.random.default_rng(0), 0, kr.load(name)
    for seed in range(100):
        side = rng.choice([-1.0, 1.0])
        state = [side * rng.uniform(3.0, 5.0), rng.uniform(-1.0, 1.0)]
        if name == 'cart_pole':
            state = [side * rng.uniform(0.4, 0.6), 0.0, 0.0, 0.0]
        planned, clipped = (
            cost(scenario, kr.simulate(name, {**start(state), **law}, seconds=6.0, seed=seed,
                                       input_limit=most))
            for law in ({'law': 'mpc', **limits}, {'law': 'lqr'})
        )  # fmt: skip
        lower += planned < clipped
    assert lower >= least


def test_an_object_of_matrices_keeps_its_limits_and_prints_them():
    control = kr.mpc(*MASS, dt=0.1, input_limit=0.5, state_limit={'x1': (-0.4, 0.4)})
    x, F, G = np.array([2.0, 0.0]), np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([0.005, 0.1])
    for _ in range(150):
        u = control.step(x)
        assert np.abs(u) <= 0.5
        x = F @ x + G * u
        assert np.abs(x[1]) < 0.401
    assert np.abs(x).max() < 0.02 and control.limited > 10 and control.infeasible == 0
    text = repr(control)
    assert 'u0 within ± 0.5' in text and 'x1 within -0.4 to 0.4, price 1e+06 a second' in text
    np.testing.assert_allclose(control.gain, kr.lqr(*MASS, dt=0.1).gain)


def test_an_input_that_pushes_more_than_it_pulls_is_planned_so(tmp_path):
    control = kr.mpc(*MASS, dt=0.1, input_limit=0.5, input_lower_limit=-0.1)
    x, F, G, inputs = np.array([1.0, 0.0]), np.array([[1.0, 0.1], [0.0, 1.0]]), [0.005, 0.1], []
    control.step(x)
    planned = control.plan.inputs
    assert planned.min() == pytest.approx(-0.1, abs=1e-3) and planned.max() < 0.5
    for _ in range(150):
        inputs.append(control.step(x))
        x = F @ x + np.array(G) * inputs[-1]
    assert np.min(inputs) == -0.1 and np.abs(x).max() < 0.02
    assert 'u0 within -0.1 to 0.5' in repr(control)
    lines = [line.get_ydata()[0] for line in control.plot()[2, 0].lines]
    assert {-0.1, 0.5} <= set(lines)


class Hovering(kr.Model):
    """A height, with a propeller that only pushes."""

    state, input = Space(('z', 'v'), ('m', 'm/s')), Space(('thrust',), ('N',))
    equilibrium = OperatingPoint(np.zeros(2), np.array([9.81]))

    def derivative(self, x, u):
        return np.stack((x[..., 1], u[..., 0] - 9.81), axis=-1)

    def noise_density(self, x):
        return np.diag([0.0, 1e-4])


def test_the_first_input_follows_that_at_rest():
    control = kr.mpc(Hovering(), [1, 0.1], 0.1, dt=0.05, input_limit=20, input_lower_limit=2,
                     input_rate_limit=1.0)  # fmt: skip
    np.testing.assert_allclose(control.step([-5.0, 0.0]), 9.81 + 0.05)
    with pytest.raises(ValueError, match=r'^input_limit: expected .* the input at rest \[9.81\]'):
        kr.mpc(Hovering(), [1, 0.1], 0.1, dt=0.05, input_limit=5)


@pytest.mark.parametrize('law', ['lqr', 'mpc'])
def test_a_loop_of_objects_begins_at_rest(law):
    built = kr.make_scenario(Hovering(), ([[1.0, 0.0]], [[1e-4]]), rate=100.0, law=law,
                             initial=(np.zeros(2), 1e-6 * np.eye(2)))  # fmt: skip
    run = kr.simulate(built, seconds=1.0, seed=1, input_rate_limit=10.0)
    assert abs(run.input[0, 0] - 9.81) <= 0.1 + 1e-9
    assert np.abs(run.truth[:, 0]).max() < 0.1


@pytest.mark.parametrize('mass', [1.0, 1e4, 1e7])
def test_a_heavy_mass_keeps_its_hard_limit_as_a_light_one(mass):
    cost = np.diag([1.0, 0.1]) * mass**2
    control = kr.mpc(
        [[0, 1], [0, 0]], [0, 1 / mass], cost, 0.1, dt=0.1, input_limit=0.5 * mass,
        state_limit={'x1': (-0.4, 0.4)}, state_price=np.inf,
    )  # fmt: skip
    x, F, G = np.array([2.0, 0.0]), np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([0.005, 0.1])
    slowest = 0.0
    for _ in range(60):
        x = F @ x + G * (control.step(x) / mass)
        slowest = min(slowest, x[1])
    assert slowest == pytest.approx(-0.4, abs=1e-6)
    assert control.infeasible == 0


def test_its_plan_is_drawn(tmp_path):
    control = kr.mpc(*MASS, dt=0.1, input_limit=0.5, state_limit={'x1': (-0.4, 0.4)})
    control.step([2.0, 0.0])
    plan = control.plan
    assert len(plan.time) == len(plan.states) == len(plan.inputs) + 1
    assert np.abs(plan.inputs).max() < 0.51 and plan.states[:, 1].min() > -0.401
    control.plot(tmp_path / 'plan.png')
    assert (tmp_path / 'plan.png').stat().st_size > 10_000


def test_a_model_is_held_at_its_equilibrium():
    model = kr.load('cart_pole').model
    control = kr.mpc(model, [5000, 0, 100, 0], 1, dt=0.01, input_limit=10)
    assert not control.step(model.equilibrium.state).any()
    np.testing.assert_allclose(control.step([0.5, 0.0, 0.0, 0.0]), [10.0])


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        ({}, r'^dt: expected the length of a step'),
        ({'dt': 0.1, 'state_limit': {'z': (0, 1)}}, r"^state_limit: expected names .* got 'z'"),
        ({'dt': 0.1, 'state_limit': {'x0': (1, 0)}}, r'^state_limit\.x0: expected \[low, high\]'),
        ({'dt': 0.1, 'state_limit': {'x0': (0, 1, 2)}}, r'^state_limit\.x0: expected \[low, high'),
        ({'dt': 0.1, 'state_limit': {'x0': (np.nan, 1)}}, r'^state_limit\.x0: expected \[low, hi'),
        ({'dt': 0.1, 'state_limit': 3}, r'^state_limit: expected limits by name'),
        (
            {'dt': 0.1, 'state_limit': {'x0': 3}},
            r'^state_limit\.x0: expected \[low, high\], got 3',
        ),
        ({'dt': 0.1, 'state_limit': {'x0': ('a', 2)}}, r'^state_limit\.x0: expected real numbers'),
        ({'dt': 0.1, 'horizon': 'a'}, r'^horizon: expected a number'),
        ({'dt': 0.1, 'moves': None}, r'^moves: expected a whole number'),
        ({'dt': 0.1, 'moves': 2.5}, r'^moves: expected a whole number'),
        ({'dt': 0.1, 'state_price': 'a'}, r'^state_price: expected real numbers'),
        ({'dt': 0.1, 'input_limit': 'a'}, r'^input_limit: expected real numbers'),
        ({'dt': 0.1, 'horizon': 1e9}, r'^horizon: expected 0\.1 to 200 s'),
        ({'dt': 0.1, 'horizon': np.nan}, r'^horizon: expected 0\.1 to 200 s'),
        ({'dt': 0.1, 'horizon': 0.04}, r'^horizon: expected 0\.1 to 200 s'),
        ({'dt': 0.1, 'moves': 0}, r'^moves: expected a whole number from 1 to 200'),
        ({'dt': 0.1, 'state_price': 0}, r'^state_price: expected positive'),
        ({'dt': 0.1, 'state_price': np.nan}, r'^state_price: expected numbers, got'),
        ({'dt': 0.1, 'input_limit': -1}, r'^input_limit: expected at least 0'),
    ],
)
def test_what_is_no_program_is_refused_by_name(arguments, reason):
    with pytest.raises(ValueError, match=reason):
        kr.mpc(*MASS, **arguments)


@pytest.mark.parametrize(
    ('values', 'reason'),
    [
        ({'state_limit.x': [1.0, -1.0]}, r'state_limit\.x: expected \[low, high\]'),
        ({'state_limit.x': [1.0]}, r'state_limit\.x: expected \[low, high\]'),
        ({'state_limit.z': [0.0, 1.0]}, r"unknown parameter 'state_limit\.z'"),
        ({'horizon': 1e4}, r'horizon: expected 0\.01 to 20 s'),
        ({'moves': 0}, r'moves: expected 1 to 200'),
        ({'state_price': [0.0]}, r'state_price: expected at least 1e-09'),
        ({'state_price': [1.0, 2.0, 3.0]}, r'state_price: expected 1 or 4'),
    ],
)
def test_a_scenario_refuses_what_is_no_limit(values, reason):
    with pytest.raises(ValueError, match=reason):
        kr.simulate('cart_pole', {'law': 'mpc', **values}, seconds=0.1)


def test_limits_of_states_are_a_section():
    limited = kr.load('cart_pole', {'law': 'mpc', 'state_limit.x': [-1.0, 1.0]})
    assert limited.law_options['state_limit.x'] == [-1.0, 1.0]
    with pytest.raises(ValueError, match='state_limit'):
        kr.load('cart_pole', {'law': 'lqr', 'state_limit.x': [-1.0, 1.0]})


@pytest.mark.thorough
def test_a_limit_of_an_angle_may_be_beyond_half_a_turn():
    robot = {'model_parameters.command_time': 0.2, 'initial_state': [0.0, 0.0, 0.0, 3.0, 0.0],
             'initial_estimate': [0.0, 0.0, 0.0, 3.0, 0.0], 'law': 'mpc',
             'horizon': 0.5}  # fmt: skip
    path = np.array([[0.0, 0.0], [-1.0, 0.0], [-2.0, -0.3]])
    motion = kr.motion('diff_drive', robot, path=path)
    runs = [
        kr.simulate('diff_drive', {**robot, **limit}, seconds=4.0, reference=motion)
        for limit in ({}, {'state_limit.psi': [2.0, 4.5]})
    ]
    np.testing.assert_allclose(runs[0].truth, runs[1].truth, atol=1e-6)


def test_a_step_without_a_plan_has_none_to_show():
    control = kr.mpc(
        [[0, 1], [0, 0]], [0, 1], [1, 0], 1, dt=0.1, input_limit=0.1,
        state_limit={'x0': (-0.5, 0.5)}, state_price=np.inf,
    )  # fmt: skip
    assert control.step([1.0, 0.0]) == pytest.approx([-0.1])
    assert control.infeasible == 1
    with pytest.raises(ValueError, match='^plan: the last step found none within the limits'):
        _ = control.plan
    control.step([0.1, 0.0])
    assert np.abs(control.plan.inputs).max() <= 0.1 + 1e-9


@pytest.mark.parametrize('begins', mostly_thorough([1.0, 1.05], 1.05))
def test_limits_that_have_to_be_kept_and_cannot_do_not_drop_the_pole(begins):
    parameters = {
        **start([begins, 0.0, 0.0, 0.0]), 'law': 'mpc', 'state_price': np.inf,
        'state_limit.x': [-1.0, 1.0], 'state_limit.theta': [-0.4, 0.4],
    }  # fmt: skip
    for seed in range(3):
        run = kr.simulate('cart_pole', parameters, seconds=3.0, seed=seed, input_limit=10)
        assert np.abs(run.truth[:, 2]).max() < 0.6
        assert np.abs(run.truth[-1, 0]) < 0.3
