# SPDX-License-Identifier: Apache-2.0
"""An observer with fixed gains is judged by the theory of its own gains."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from kalman_ros import scenario
from kalman_ros.analysis.checks import is_optimum, theory
from kalman_ros.analysis.design_report import DesignReport
from kalman_ros.analysis.design_theory import report
from kalman_ros.analysis.design_warnings import notes
from kalman_ros.analysis.input_loops import even_estimator
from kalman_ros.analysis.nis_spread import nis_variances
from kalman_ros.analysis.verdict import judge
from kalman_ros.estimators.fixed_gain import FixedGainObserver
from kalman_ros.scenario.estimation import fixed_gain_observer
from kalman_ros.scenario.regulator import regulator
from kalman_ros.simulation import closed_loop

#: Far from the least error, with two sensors of which one reads in every fifth step.
SLOW = {'filter': 'luenberger', 'observer_poles': [-1.0, -1.2, -1.4, -1.6]}
RUNS, STEPS, START = 3000, 400, 400


def squares(plan, gains, seed=1):
    """Return the mean NIS of each run and sensor, from errors that are computed step by step."""
    rng, n = np.random.default_rng(seed), plan.model.state.size
    F, _, Q = plan.model.sampled(plan.dt)
    parts = {
        name: (timed.sensor.jacobian(np.zeros(n)), gains[name], timed.sensor.covariance)
        for name, timed in plan.sensors.items()
    }
    e, P, found = np.zeros((RUNS, n)), np.zeros((n, n)), {name: [] for name in parts}
    root = np.linalg.cholesky(Q + 1e-15 * np.eye(n))
    for step in range(START + STEPS):
        e = e @ F.T + rng.normal(size=e.shape) @ root.T
        P = F @ P @ F.T + Q
        for name in plan.due(step):
            C, L, R = parts[name]
            v = rng.normal(size=(RUNS, len(R))) @ np.linalg.cholesky(R).T
            innovation = e @ C.T + v
            S = C @ P @ C.T + R
            nis = np.einsum('ri,ij,rj->r', innovation, np.linalg.inv(S), innovation)
            if step >= START:
                found[name].append(nis)
            e = e - innovation @ L.T
            J = np.eye(n) - L @ C
            P = J @ P @ J.T + L @ R @ L.T
    return {name: np.array(each) for name, each in found.items()}


def test_the_mean_nis_scatters_as_the_correlation_of_innovations_says():
    built = scenario.build(SLOW)
    observer = fixed_gain_observer(built)
    expected = nis_variances(built.plan, observer)
    for name, nis in squares(built.plan, observer.gains).items():
        k = built.sensors[name].sensor.output.size
        assert nis.mean() == pytest.approx(k, rel=0.02)
        ratio = nis.mean(axis=0).var() * len(nis) / expected[name]
        assert ratio == pytest.approx(1.0, abs=0.12)
    assert expected['position'] > 1.5 * 4.0  # more than if they were white


def test_innovations_of_the_least_error_are_white():
    plan = scenario.build({'velocity.enabled': False, 'position.rate': 100.0}).plan
    white = nis_variances(plan, None)
    steady = scenario.build(
        {'velocity.enabled': False, 'position.rate': 100.0, 'filter': 'steady_state'}
    )
    assert nis_variances(plan, fixed_gain_observer(steady)) == pytest.approx(white, rel=1e-9)
    assert white == {'position': 4.0}


def test_the_errors_of_an_observer_solve_the_equation_of_lyapunov():
    built = scenario.build({**SLOW, 'velocity.enabled': False, 'position.rate': 100.0})
    observer, found = fixed_gain_observer(built), theory(built).loop
    F, _, Q = built.model.sampled(built.plan.dt)
    sensor = built.enabled['position'].sensor
    L, C = observer.gains['position'], sensor.jacobian(np.zeros(4))
    J = np.eye(4) - L @ C
    expected = solve_discrete_lyapunov(J @ F, J @ Q @ J.T + L @ sensor.covariance @ L.T)
    np.testing.assert_allclose(found.posterior[0], expected, rtol=1e-8, atol=1e-14)
    poles = np.sort_complex(np.linalg.eigvals(J @ F))
    np.testing.assert_allclose(np.sort_complex(found.estimator_poles), poles, rtol=1e-8)


def test_readings_of_one_step_count_one_after_the_other():
    built = scenario.build(SLOW)
    observer = fixed_gain_observer(built)
    sensors = [source.sensor for source in built.enabled.values()]
    rng = np.random.default_rng(0)
    belief = built.initial_belief
    readings = [rng.normal(size=sensor.output.size) for sensor in sensors]
    expected = belief
    for sensor, y in zip(sensors, readings):
        expected = observer.correct(expected, y, sensor).posterior
    x = belief.mean
    innovation = np.concatenate([y - sensor.measure(x) for y, sensor in zip(readings, sensors)])
    joint = observer.joint_gain(sensors)
    assert isinstance(observer, FixedGainObserver)
    np.testing.assert_allclose(x + joint @ innovation, expected.mean, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(4))
@pytest.mark.parametrize('filter', ['luenberger', 'steady_state'])
def test_a_healthy_observer_passes(filter, seed):
    built = scenario.build({'filter': filter} if filter == 'steady_state' else SLOW)
    run = closed_loop.run(built, regulator(built)[0].gain, 60.0, seed)
    judgement = judge(built, run)
    assert [check.name for check in judgement.checks if not check.passed] == []
    assert 'not the optimum' in judgement.basis  # which repeats every five steps


def test_a_fixed_gain_is_the_best_where_every_step_has_the_same_readings():
    every = {'velocity.enabled': False, 'position.rate': 100.0}
    for filter, changes, best in (
        ('kf', {}, True),
        ('kf', every, True),
        ('steady_state', {}, False),
        ('steady_state', every, True),
        ('luenberger', every, False),
        ('gaussian_sum', {}, True),
    ):
        assert is_optimum(scenario.build({**changes, 'filter': filter})) is best
    assert not is_optimum(scenario.build({'law': 'placement'}))


@pytest.mark.slow
def test_an_observer_with_other_gains_than_believed_fails():
    believed = scenario.build(SLOW)
    real = scenario.build({**SLOW, 'observer_poles': [-3.0, -3.2, -3.4, -3.6]})
    run = closed_loop.run(real, regulator(real)[0].gain, 60.0, 0)
    failed = {check.name for check in judge(believed, run).checks if not check.passed}
    assert 'estimator dynamics, misfit^2' in failed


def test_a_slow_sensor_counts_in_its_share_of_the_steps_of_an_even_loop():
    built = scenario.build({**SLOW, 'velocity.enabled': False})  # position at 20 of 100 Hz
    even = even_estimator(built, built.model.equilibrium)
    L = fixed_gain_observer(built).gains['position']
    np.testing.assert_allclose(even.gain, 0.2 * L, rtol=1e-12)
    F, C = built.model.sampled(0.01).F, built.enabled['position'].sensor.jacobian(np.zeros(4))
    np.testing.assert_allclose(even.predictor_gain, F @ even.gain, rtol=1e-12)
    expected = np.sort_complex(np.linalg.eigvals(F - F @ even.gain @ C))
    np.testing.assert_allclose(np.sort_complex(even.poles), expected, rtol=1e-9)


def test_a_design_has_the_gains_poles_and_margins_of_its_observer():
    every = {'velocity.enabled': False, 'position.rate': 100.0}
    designs: dict[str, DesignReport] = {
        filter: report(scenario.build({**every, **options}))
        for filter, options in {'kf': {}, 'luenberger': SLOW}.items()
    }
    built = designs['luenberger'].scenario
    L = fixed_gain_observer(built).gains['position']
    found = designs['luenberger'].estimator
    np.testing.assert_allclose(found.gains['position'], L, rtol=1e-12)
    assert np.all(found.std > designs['kf'].estimator.std)
    slow, best = (designs[kind].regulator.loops[0] for kind in ('luenberger', 'kf'))
    # the loop with the observer has the poles of the regulator and of the observer
    closed = slow.estimated.broken
    poles = np.linalg.eigvals(closed.A - closed.B @ closed.C)
    F, C = built.model.sampled(0.01).F, built.enabled['position'].sensor.jacobian(np.zeros(4))
    for pole in np.linalg.eigvals(F - F @ L @ C):
        assert np.abs(poles - pole).min() < 1e-7
    assert slow.estimated.margins != best.estimated.margins
    assert designs['luenberger'].closed_loop.cost > designs['kf'].closed_loop.cost


@pytest.mark.parametrize(
    ('poles', 'rates', 'asked'),
    [
        ([-3.0], (20.0, 100.0), ''),  # near enough
        ([-9.0, -9.5, -12.0, -13.0], (20.0, 20.0), 'poles at -9, -9.5, -12, -13 1/s'),
    ],
)
def test_a_design_says_which_poles_were_asked_for_where_rates_change_them(poles, rates, asked):
    built = scenario.build({
        'filter': 'luenberger', 'observer_poles': poles,
        'position.rate': rates[0], 'velocity.rate': rates[1],
    })  # fmt: skip
    said = [note for note in notes(report(built)) if 'observer' in note]
    assert len(said) == bool(asked)
    assert all(asked in note for note in said)
    assert not [note for note in notes(report(scenario.build({}))) if 'observer' in note]
