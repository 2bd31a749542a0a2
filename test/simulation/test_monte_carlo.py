# SPDX-License-Identifier: Apache-2.0
"""Many runs together are the runs one by one, however they are divided."""

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
from thorough import mostly_thorough

import kalman_ros as kr
from kalman_ros.arrays.loop_setup import Given, loop_of
from kalman_ros.control.limiter import LIMITS
from kalman_ros.scenario import shipped
from kalman_ros.scenario.regulator import price
from kalman_ros.simulation.batch_loop import Loop
from kalman_ros.simulation.linear_runs import is_linear
from kalman_ros.simulation.monte_carlo import Experiment, monte_carlo, spawned
from kalman_ros.simulation.run_statistics import Outcomes, RunStatistics
from kalman_ros.simulation.simulated_plant import SimulatedPlant

NAMES = sorted(path.stem for path in shipped.folder().glob('*.yaml'))
STEPS = 40


def experiment_of(name, overrides=None, steps=STEPS, first=5, **given):
    limits = {each: np.ravel(given.pop(each)) for each in LIMITS if each in given}
    loop, law = loop_of(name, overrides, Given(**given, limits=limits), 0.0)
    weight = price(loop.believed).weight if law else None
    return Experiment(replace(loop, seconds=steps / loop.scenario.rate), weight, first)


def one_by_one(experiment, seeds):
    """The oracle: the same loops, each in the code for one."""
    return Outcomes.joined([experiment.outcome(seed) for seed in seeds])


def differences(a, b):
    """Yield each field's largest difference, relative to what its numbers are like."""
    for each in fields(Outcomes):
        pairs = [(getattr(a, each.name), getattr(b, each.name))]
        if each.name == 'nis':
            pairs = [(a.nis[name], b.nis[name]) for name in a.nis]
        for x, y in pairs:
            assert np.array_equal(np.isnan(x), np.isnan(y)), each.name
            x, y = np.nan_to_num(x), np.nan_to_num(y)
            size = np.abs(y) + np.abs(y).max(initial=0.0)
            yield each.name, float((np.abs(x - y) / np.where(size, size, 1.0)).max(initial=0.0))


@pytest.mark.slow
@pytest.mark.parametrize('name', mostly_thorough(NAMES, *NAMES[::3]))
def test_runs_together_are_runs_one_by_one(name):
    experiment, seeds = experiment_of(name), spawned(3, 3)
    together = monte_carlo(experiment, seeds)
    for field, difference in differences(together, one_by_one(experiment, seeds)):
        assert difference <= 1e-10, field


@pytest.mark.parametrize(
    ('overrides', 'given'),
    [
        ({'position.gate': 0.9, 'velocity.gate': 0.8}, {}),
        ({'law': 'lqi', 'tracked': ['x', 'y']}, {'reference': {'x': 0.25}, 'input_limit': 0.6}),
        ({'filter': 'ukf'}, {'input_rate_limit': 3.0}),
        ({'filter': 'luenberger'}, {'reference': lambda t: {'y': 1.0 if t > 0.3 else 0.0}}),
        ({'position.rate': 30.0, 'velocity.enabled': False}, {'input_limit': [0.3, 0.9]}),
    ],
)
def test_gates_laws_limits_and_references_too(overrides, given):
    experiment, seeds = experiment_of('mass_spring_damper_2d', overrides, **given), spawned(3, 3)
    together = monte_carlo(experiment, seeds)
    assert 'input_limit' not in given or together.limited.all()
    for field, difference in differences(together, one_by_one(experiment, seeds)):
        assert difference <= 1e-10, field


def both(**settings):
    return {f'{name}.{key}': v for name in ('position', 'velocity') for key, v in settings.items()}


FAULTS = {
    'dropout': both(dropout=0.4),
    'bursts': both(burst_loss=0.2, burst_length=4.0),
    'nan': {'position.nan': 0.5},
    'outliers, gates': both(outliers=0.3, gate=0.99),
    'values': both(bias=[0.2], drift=[0.1], random_walk=[0.3]),
    'freeze, window': {'position.freeze': True, 'position.fault_window': [0.1, 0.3]},
    'duplication': both(duplication=0.5),
    'all at once': both(dropout=0.2, nan=0.1, outliers=0.1, bias=[0.1], duplication=0.3),
    'actuator': {'actuator_gain': [0.5, 2.0], 'actuator_loss': 0.4, 'actuator_dead_zone': [0.1]},
    'actuator delay': {'actuator_delay': 0.025},
    'pushes': {
        'disturbance_constant': [1.0], 'disturbance_amplitude': [0.0, 2.0],
        'disturbance_noise': [0.5], 'fault_window': [0.05, 0.35],
    },
    'late': both(delay=0.03, jitter=0.05, reordering=0.3),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize('fault', FAULTS)
def test_faults_too(fault):
    experiment, seeds = experiment_of('mass_spring_damper_2d', FAULTS[fault]), spawned(3, 3)
    together = monte_carlo(experiment, seeds)
    for field, difference in differences(together, one_by_one(experiment, seeds)):
        assert difference <= 1e-10, field
    sound = monte_carlo(experiment_of('mass_spring_damper_2d'), seeds)
    if fault != 'duplication':
        assert (together.final_error != sound.final_error).any(axis=1).all()
    else:
        assert np.allclose(together.final_error, sound.final_error, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize('name', ['cart_pole', 'diff_drive', 'gnss_imu'])
def test_faults_of_models_with_angles_and_other_steps(name):
    sensors = kr.load(name).sensors
    faults = {
        f'{each}.{key}': v for each in sensors for key, v in (('dropout', 0.3), ('nan', 0.1))
    }
    experiment = experiment_of(name, {**faults, 'disturbance_noise': [0.1]})
    seeds = spawned(3, 3)
    together = monte_carlo(experiment, seeds)
    for field, difference in differences(together, one_by_one(experiment, seeds)):
        assert difference <= 1e-10, field


def test_a_plant_other_than_believed():
    real, believed = (
        kr.load('mass_spring_damper', {'model_parameters.mass': 3.0}),
        kr.load('mass_spring_damper'),
    )
    _, law = loop_of(believed, None, Given(), 0.0)
    experiment = Experiment(Loop(real, believed, 2.0, law), price(believed).weight, 0)
    seeds = spawned(0, 2)
    together = monte_carlo(experiment, seeds)
    for field, difference in differences(together, one_by_one(experiment, seeds)):
        assert difference <= 1e-10, field


@pytest.mark.slow
def test_runs_that_diverge_end_like_single_ones():
    _, law = loop_of('mass_spring_damper_2d', None, Given(gain=-1e4 * np.ones((2, 4))), 0.0)
    loop = experiment_of('mass_spring_damper_2d', steps=400).loop
    runaway = Experiment(Loop(loop.scenario, loop.believed, 20.0, law), None, 0)
    seeds = spawned(0, 2)
    a, b = monte_carlo(runaway, seeds), one_by_one(runaway, seeds)
    # one of them may overflow in one coordinate earlier, but none is mistaken for a good run
    for found in (a, b):
        assert not np.isfinite(found.squared_error).all(axis=1).any()


@pytest.mark.parametrize('name', ['mass_spring_damper_2d'])
@pytest.mark.parametrize(
    'divided',
    [{'chunk': 1}, {'chunk': 4}, pytest.param({'workers': 2, 'chunk': 3}, marks=pytest.mark.slow)],
)
def test_the_numbers_do_not_depend_on_how_runs_are_divided(name, divided):
    experiment, seeds = experiment_of(name), spawned(1, 7)
    done = []
    parts = monte_carlo(experiment, seeds, **divided, progress=done.append)
    assert done[-1] == 7 and done == sorted(done)
    for field, difference in differences(parts, monte_carlo(experiment, seeds)):
        assert difference <= 1e-12, field


def test_a_linear_loop_by_matrix_products_is_the_loop_step_by_step(monkeypatch):
    changes = {'position.rate': 40.0, 'velocity.noise': [0.1, 0.2]}
    experiment, seeds = experiment_of('mass_spring_damper_2d', changes), spawned(3, 4)
    assert is_linear(experiment.loop)
    products = monte_carlo(experiment, seeds)
    monkeypatch.setattr(Experiment, '_linear', None)
    stepwise = monte_carlo(experiment_of('mass_spring_damper_2d', changes), seeds)
    for field, difference in differences(products, stepwise):
        assert difference <= 1e-12, field


@pytest.mark.parametrize(
    ('name', 'overrides', 'given'),
    [
        ('mass_spring_damper_2d', {'position.gate': 0.9}, {}),
        ('mass_spring_damper_2d', {'law': 'lqi', 'tracked': ['x', 'y']}, {}),
        ('mass_spring_damper_2d', {}, {'input_limit': 0.6}),
        ('mass_spring_damper_2d', {}, {'reference': {'x': 1.0}}),
        ('mass_spring_damper_2d', {'filter': 'ukf'}, {}),
        ('cart_pole', {}, {}),
    ],
)
def test_loops_that_are_not_linear_are_not_taken_for_linear(name, overrides, given):
    assert experiment_of(name, overrides, **given)._linear is None


def test_run_k_is_the_same_however_many_there_are():
    assert spawned(5, 3) == spawned(5, 10)[:3]
    assert len({*spawned(5, 1000), *spawned(6, 1000)}) == 2000


@pytest.mark.thorough
@pytest.mark.slow
def test_a_filter_without_a_batched_form_runs_one_by_one():
    found = kr.monte_carlo('bearing_tracker', runs=2, seconds=20.0, after=0.0)
    run = found.run(1)
    error = run.scenario.model.state.subtract(run.truth, run.estimate)
    np.testing.assert_allclose(found.outcomes.squared_error[1], np.mean(error**2, axis=0))


def test_single_runs_are_those_of_the_plant_and_its_noise():
    """The batch draws from the same streams, a seed's numbers in one block."""
    scenario = kr.load('mass_spring_damper_2d')
    plant = SimulatedPlant(
        scenario.model, scenario.timed, scenario.rate, scenario.initial_state, 11
    )
    loop = Loop(scenario, scenario, 0.5)
    for _ in range(loop.steps - 1):
        plant.step(np.zeros(2))
    found = monte_carlo(Experiment(loop, None, 0), [11])
    np.testing.assert_allclose(found.final_state[0], plant.state, rtol=1e-12)


@pytest.mark.parametrize('alike', [True, False])
@pytest.mark.parametrize('lost', [False, True])
def test_a_run_that_is_not_finite_counts_in_no_sum_over_runs(lost, alike):
    """Of three runs, with one covariance for all of them or one each."""
    loop = experiment_of('mass_spring_damper', steps=1).loop
    rng = np.random.default_rng(8)
    truth, estimate = rng.normal(size=(2, 3, 2))
    P = np.eye(2) if alike else np.array([1.0, 4.0, 9.0])[:, None, None] * np.eye(2)
    if lost:
        truth[1, 0] = np.nan
    estimator = SimpleNamespace(
        belief=(estimate, P), whitened=lambda e: e / np.sqrt(P.diagonal(axis1=-2, axis2=-1))
    )
    statistics = RunStatistics(loop, 3, None, 0)
    statistics.step(estimator, truth, np.zeros(1))
    found = statistics.outcomes(0)
    kept = [0, 2] if lost else [0, 1, 2]
    squares = (truth - estimate)[kept] ** 2
    variance = np.array([1.0, 1.0, 1.0] if alike else [1.0, 4.0, 9.0])[kept]
    assert found.count[0] == len(kept)
    np.testing.assert_allclose(found.step_squares[0], squares.sum(axis=0))
    np.testing.assert_allclose(found.step_variance[0], variance.sum())
    assert found.step_nees[0] == pytest.approx((squares / variance[:, None]).sum())
