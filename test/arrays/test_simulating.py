# SPDX-License-Identifier: Apache-2.0
"""Whole loops in one process: scenarios by name or of objects, references, limits, pictures."""

import re
from pathlib import Path

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.scenario.regulator import regulator
from kalman_ros.simulation import closed_loop


@pytest.mark.slow
def test_a_run_is_that_of_the_closed_loop():
    run = kr.simulate('cart_pole', seconds=2, seed=1)
    scenario = kr.load('cart_pole')
    same = closed_loop.run(scenario, regulator(scenario)[0].gain, 2.0, 1)
    np.testing.assert_allclose(run.truth, same.truth, atol=1e-12)
    np.testing.assert_allclose(run.input, same.input, atol=1e-11)
    assert kr.consistency(run)
    assert kr.load(Path('cart_pole')).model.state.names == scenario.model.state.names
    assert str(run).startswith('CartPole for 2 s at 100 Hz, filter ekf, law lqr')
    assert all(len(line) < 80 for line in str(run).splitlines())


@pytest.mark.slow
@pytest.mark.parametrize('law', ['lqr', 'lqi', 'placement'])
def test_a_reference_is_held(law):
    loop = {'law': law}
    if law == 'placement':
        loop['regulator_poles'] = [-2.0]
    run = kr.simulate('mass_spring_damper_2d', loop, seconds=12, reference={'x': 1.0, 'y': -0.5})
    late = run.truth[run.time > 8].mean(axis=0)
    places = run.scenario.model.state.indices(['x', 'y'])
    np.testing.assert_allclose(late[places], [1.0, -0.5], atol=0.25)


@pytest.mark.slow
def test_lqi_leaves_no_error_where_lqr_does(tmp_path):
    """With a spring of the plant that is stiffer than believed."""
    path = tmp_path / 'stiff.yaml'
    path.write_text(
        '/**: {ros__parameters: {model: mass_spring_damper}}\n'
        'plant: {ros__parameters: {model_parameters: {stiffness: 20.0}}}\n'
    )
    ends = {}
    for law, options in {'lqr': {}, 'lqi': {'integral_cost': [20.0]}}.items():
        run = kr.simulate(path, {'law': law, **options}, seconds=20, reference={'x': 1.0})
        ends[law] = run.estimate[run.time > 12, 0].mean()
    assert ends['lqr'] < 0.5
    np.testing.assert_allclose(ends['lqi'], 1.0, atol=0.1)


def test_limits_hold():
    run = kr.simulate(seconds=3, seed=2, input_limit=0.5, input_rate_limit=[1.0, 2.0])
    assert np.abs(run.input).max() <= 0.5
    slope = np.abs(np.diff(run.input, axis=0)) * 100
    assert slope[:, 0].max() < 1.0 + 1e-9 < slope[:, 1].max() < 2.0 + 1e-9
    assert run.limited > 10
    assert f'a limit changed the input in {run.limited} of 301 steps' in repr(run)
    run = kr.simulate(seconds=3, seed=2, input_limit=[0.5, 0.4], input_lower_limit=[-0.1, -np.inf])
    np.testing.assert_array_equal(run.input.min(axis=0), [-0.1, -0.4])
    np.testing.assert_array_equal(run.input.max(axis=0), [0.5, 0.4])
    same = kr.simulate({}, {'input_limit': [0.5]}, seconds=1, seed=2)
    assert np.abs(same.input).max() <= 0.5


@pytest.mark.slow
def test_a_loop_begins_at_the_idle_input_of_its_file(monkeypatch):
    folder = Path(__file__).parents[2] / 'docs' / 'examples' / 'mujoco'
    monkeypatch.syspath_prepend(str(folder))
    given = {'seconds': 0.5, 'seed': 1, 'input_rate_limit': [1.0, 100.0]}
    for idle, first in (('equilibrium', 1.204 * 9.81), ('zero', 0.0)):
        run = kr.simulate(str(folder / 'quadrotor.yaml'), {'idle_input': idle}, **given)
        assert abs(run.input[0, 0] - first) < 0.02
    lower = {'input_limit': [24.0, 1.0], 'input_lower_limit': [2.0, -1.0]}
    with pytest.raises(ValueError, match=r'^input_lower_limit: .*; or choose idle_input: equilib'):
        kr.simulate(str(folder / 'quadrotor.yaml'), {'idle_input': 'zero'}, seconds=0.1, **lower)


@pytest.mark.slow
def test_a_reference_in_time():
    run = kr.simulate(
        'mass_spring_damper', seconds=20, reference=lambda time: {'x': 1.0 if time >= 10 else 0.0}
    )
    assert run.truth[(run.time > 6) & (run.time < 10), 0].mean() < 0.3
    assert run.truth[run.time > 17, 0].mean() > 0.7


@pytest.mark.slow
def test_a_plant_other_than_believed_comes_from_the_file(tmp_path):
    path = tmp_path / 'heavy.yaml'
    path.write_text(
        '/**: {ros__parameters: {model: mass_spring_damper}}\n'
        'plant: {ros__parameters: {model_parameters: {mass: 5.0}}}\n'
        'controller: {ros__parameters: {input_limit: [0.1]}}\n'
    )
    run = kr.simulate(path, seconds=2)
    assert np.abs(run.input).max() <= 0.1
    same = kr.simulate('mass_spring_damper', seconds=2, input_limit=0.1)
    assert np.abs(run.truth - same.truth).max() > 0.01
    assert kr.design(path).report.scenario.model.A.tolist() == same.scenario.model.A.tolist()


@pytest.mark.slow
def test_a_gain_of_ones_own():
    model = kr.load('cart_pole').model
    gain = kr.lqr(model, [5000, 0, 100, 0], 1, dt=0.01)
    run = kr.simulate('cart_pole', seconds=1, gain=gain)
    np.testing.assert_allclose(run.input, kr.simulate('cart_pole', seconds=1).input, atol=1e-9)


@pytest.mark.slow
def test_a_scenario_of_objects():
    model = kr.continuous_model([[0, 1], [0, 0]], [0, 1], [0, 0.01], states=['x', 'v'])
    sensors = {'gps': ([1, 0], 0.01), 'speed': ([0, 1], 0.04)}
    scenario = kr.make_scenario(
        model, sensors, rate=50, rates={'gps': 10}, initial=([0, 0], 0.1), initial_state=[1, 0],
        Q=[10, 1], law='lqi', law_options={'tracked': ['x']},
    )  # fmt: skip
    run = kr.simulate(scenario, seconds=10, reference={'x': 2.0})
    assert len(run.readings['gps'].time) == 101
    assert len(run.readings['speed'].time) == 501
    np.testing.assert_allclose(run.truth[run.time > 7, 0].mean(), 2.0, atol=0.1)
    assert 'lqi' in repr(run)
    assert 'K of' in repr(kr.design(scenario))
    y = {name: series.values for name, series in run.readings.items()}
    times = {name: series.time for name, series in run.readings.items()}
    found = kr.filter(scenario, None, times, y, run.input, input_times=run.time)
    np.testing.assert_allclose(found.mean, run.estimate, atol=1e-9)
    assert kr.consistency(kr.smooth(found), run.truth)


def test_a_scenario_in_discrete_time():
    model = kr.discrete_model([[1, 1], [0, 1]], [0.5, 1], [0.01, 0.01], states=['x', 'v'])
    scenario = kr.make_scenario(model, ([1, 0], 0.25), R=10, initial=([5, 0], 1))
    assert scenario.filter == 'kf'
    run = kr.simulate(scenario, seconds=200)
    assert np.abs(run.truth[100:, 0]).max() < 5.0
    assert kr.consistency(run)
    with pytest.raises(ValueError, match='^model: the theory of a loop needs one in continuous'):
        kr.design(scenario)


def test_a_model_without_an_input():
    run = kr.simulate('constant_velocity', seconds=2)
    assert run.input.shape == (len(run.time), 0)
    with pytest.raises(ValueError, match='reference: expected none, for the model has no input'):
        kr.simulate('constant_velocity', reference=[0, 0, 0, 0])
    with pytest.raises(ValueError, match='plot: there is no force'):
        run.plot(what='force')


@pytest.mark.thorough
@pytest.mark.slow
def test_design_prints_and_draws(tmp_path):
    found = kr.design('cart_pole')
    text = repr(found)
    assert text.startswith('The input controls x, v, theta, omega')
    assert re.search(r'f, LQG +0.729 to 2.12', text)
    assert all(len(line) < 80 for line in text.splitlines())
    for what in ('loops', 'poles', 'uncertainty'):
        found.plot(tmp_path / f'{what}.png', what)
        assert (tmp_path / f'{what}.png').stat().st_size > 10_000


@pytest.mark.slow
@pytest.mark.thorough
def test_pictures(tmp_path):
    run = kr.simulate('cart_pole', seconds=5)
    for what in ('overview', 'states', 'errors', 'gains', 'innovations', 'force'):
        run.plot(tmp_path / f'{what}.png', what)
        assert (tmp_path / f'{what}.png').stat().st_size > 5_000
    with pytest.raises(ValueError, match="unknown picture 'statse'; did you mean 'states'"):
        run.plot(what='statse')


def test_without_a_path_the_figure_is_left_to_pyplot(monkeypatch):
    monkeypatch.setenv('MPLBACKEND', 'Agg')
    from matplotlib import pyplot

    before = pyplot.get_fignums()
    axes = kr.simulate(seconds=4.5).plot()
    assert len(pyplot.get_fignums()) == len(before) + 1
    pyplot.close(axes.flat[0].figure)


@pytest.mark.parametrize(
    ('call', 'says'),
    [
        (lambda: kr.simulate('cartpole'), "scenario: unknown scenario 'cartpole'; did you mean"),
        (lambda: kr.simulate('none.yaml'), "scenario: no file 'none.yaml'"),
        (lambda: kr.simulate({}, {'input_limt': 1.0}),
         "unknown parameter 'input_limt'; did you mean 'input_limit'"),
        (lambda: kr.simulate(3), 'scenario: expected a name or a file, got 3'),
        (lambda: kr.simulate(seconds=-1), 'seconds: expected a positive number of seconds'),
        (lambda: kr.simulate(reference=[1, 2]), 'reference: expected 4 numbers, got 2'),
        (lambda: kr.simulate(reference={'z': 1}), 'reference: expected names among'),
        (lambda: kr.simulate(reference={'v_x': 1}), 'reference: no input holds the system at'),
        (lambda: kr.simulate(gain=[1, 2]), 'gain: expected 2 x 4 = 8 numbers'),
        (lambda: kr.simulate(input_limit=[1, 2, 3]), 'input_limit: expected 1 or 2 numbers'),
        (lambda: kr.simulate(input_limit=-1), 'input_limit: expected at least 0'),
        (lambda: kr.simulate(input_limit={}), 'input_limit: expected real numbers'),
        (lambda: kr.simulate(gain='lqr'), 'gain: expected real numbers'),
        (lambda: kr.simulate(seed='a'), 'seed: expected a whole number from 0, got \'a\''),
        (lambda: kr.simulate(seed=-1), 'seed: expected a whole number from 0, got -1'),
        (lambda: kr.simulate('level', 5), 'overrides: expected parameters by name, got 5'),
        (lambda: kr.design(delay='soon'), "delay: expected a number of seconds, got 'soon'"),
        (lambda: kr.make_scenario(kr.load('level').model, (1, 1), rate=0),
         'rate: expected a positive number of steps a second, got 0'),
        (lambda: kr.make_scenario(kr.load('level').model, (1, 1), rate=[1]),
         'rate: expected a number, got .1.'),
        (lambda: kr.make_scenario(kr.discrete_model(1, Q=1), ([1, 2], 1)), 'y: expected 1 col'),
        (lambda: kr.make_scenario(kr.load({}).model, ([1, 0, 0, 0], 1)), 'rate: expected the st'),
        (lambda: kr.make_scenario(kr.discrete_model([[1]], Q=1), (1, 1), rates={'gsp': 1}),
         "unknown sensor 'gsp'"),
    ],
)  # fmt: skip
def test_mistakes_are_named(call, says):
    with pytest.raises(ValueError, match=f'^{says}'):
        call()


def test_a_scenario_has_the_options_of_its_filter():
    spread = {'filter': 'ukf', 'alpha': 0.1, 'beta': 2.0}
    plain = kr.simulate('cart_pole', {'filter': 'ukf'}, seconds=0.5, seed=1)
    found = kr.simulate('cart_pole', spread, seconds=0.5, seed=1)
    assert kr.load('cart_pole', spread).filter_options == {'alpha': 0.1, 'beta': 2.0}
    assert 0.0 < np.abs(found.estimate - plain.estimate).max() < 1e-3
    with pytest.raises(ValueError, match="unknown parameter 'alpha'"):
        kr.simulate('cart_pole', {'filter': 'ekf', 'alpha': 0.1}, seconds=0.5)
    with pytest.raises(ValueError, match='alpha: expected 0.0001 to 10, got 100'):
        kr.simulate('cart_pole', {'filter': 'ukf', 'alpha': 100.0}, seconds=0.5)
