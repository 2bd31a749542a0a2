# SPDX-License-Identifier: Apache-2.0
"""Verdicts on loops without a theory test NEES, with bounds that know how slowly errors forget."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from thorough import mostly_thorough, thorough

from kalman_ros import scenario
from kalman_ros.analysis.nees_spread import average_nees
from kalman_ros.analysis.verdict import consistency, judge, least_duration
from kalman_ros.estimators.consistency import NeesWindow, independent
from kalman_ros.scenario.demo_section import demo_section
from kalman_ros.scenario.parameter_files import from_file
from kalman_ros.scenario.regulator import regulator
from kalman_ros.simulation import closed_loop

CONFIG = Path(__file__).parents[2] / 'config'


def failed(built, run):
    return [check.name for check in consistency(built, run) if not check.passed]


@pytest.mark.thorough
@pytest.mark.slow
def test_of_a_linear_loop_the_spread_is_that_of_many_runs():
    built = scenario.build({'model': 'mass_spring_damper'})
    gain = regulator(built)[0].gain
    found = [average_nees(built, closed_loop.run(built, gain, 4.0, seed)) for seed in range(150)]
    means = np.array([each.mean for each in found])
    expected = found[0].variance
    assert means.mean() == pytest.approx(1.0, abs=4.0 * np.sqrt(expected / 150))
    # the sample variance of 150 values, within four of its deviations
    assert means.var() == pytest.approx(expected, rel=4.0 * np.sqrt(2.0 / 149) + 0.15)
    assert expected > 2.0 * 2.0 / (2 * 400)  # more than that of independent errors


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize(
    ('scale', 'passes'), [thorough(1.0, True), thorough(0.2, False), (8.0, False)]
)
def test_a_filter_that_is_wrong_about_itself_fails(scale, passes):
    built = scenario.build({'model': 'turn_rate'})
    run = closed_loop.run(built, None, 20.0, 1)
    wrong = replace(run, covariance=scale * run.covariance)
    assert ('NEES / 5' not in failed(built, wrong)) is passes


@pytest.mark.slow
def test_a_covariance_of_zero_fails():
    built = scenario.build({'model': 'turn_rate'})
    run = closed_loop.run(built, None, 4.0, 1)
    with np.errstate(divide='ignore', invalid='ignore'):
        assert 'NEES / 5' in failed(built, replace(run, covariance=0.0 * run.covariance))


@pytest.mark.slow
@pytest.mark.parametrize('name', ['cart_pole', 'turn_rate', 'level'])
def test_runs_too_short_to_judge_are_refused(name):
    built = scenario.build({'model': name})
    least = least_duration(built)
    assert least >= 1.0
    gain = regulator(built)[0].gain if built.law else None
    with pytest.raises(ValueError, match=rf'run: expected {least:.4g} s or more to judge it'):
        judge(built, closed_loop.run(built, gain, 0.5 * least, 0))
    assert judge(built, closed_loop.run(built, gain, least, 0)).checks


def test_correlated_errors_count_for_fewer_whatever_their_size():
    rng = np.random.default_rng(0)
    white = rng.standard_normal((4000, 3))
    repeated = np.repeat(rng.standard_normal((400, 3)), 10, axis=0)
    for size in (1.0, 1e-3, 1e6):
        assert independent(size * white) == pytest.approx(4000, rel=0.25)
        assert independent(size * repeated) == pytest.approx(400, rel=0.3)
    assert independent(np.full((500, 3), 9.0)) == pytest.approx(1.0)
    assert independent(np.array([[1.0], [np.inf]])) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize(('scale', 'inside'), [(1.0, True), (0.01, False), (50.0, False)])
@pytest.mark.parametrize(
    'name',
    mostly_thorough(['diff_drive', 'mass_spring_damper', 'constant_velocity'], 'diff_drive'),
)
def test_the_window_of_the_monitor_notices_a_covariance_that_is_wrong(name, scale, inside):
    built = scenario.build({'model': name})
    gain = regulator(built)[0].gain if built.law else None
    run = closed_loop.run(built, gain, 10.0, 3)
    window = NeesWindow(built.model.state.size)
    errors = built.model.state.subtract(run.truth, run.estimate)
    window.add_errors(errors, scale * run.covariance)
    assert window.inside() is inside


def test_the_window_knows_what_is_no_covariance():
    window = NeesWindow(2)
    right = [0.0, 1.0], np.diag([0.0, 1.0])  # certain, and rightly so
    window.add_errors(*map(np.array, zip(right)))
    assert window.mean == 0.5 and window.inside()
    for wrong in (([1.0, 0.0], np.diag([0.0, 1.0])), ([1.0, 0.0], np.diag([1.0, -1.0]))):
        window = NeesWindow(2)
        window.add_errors(*map(np.array, zip(right, wrong, right)))
        assert window.count == 3
        assert np.isinf(list(window._values)).tolist() == [False, True, False]
        assert not window.inside()


@pytest.mark.slow
def test_the_demo_of_the_bearing_tracker_shows_the_convergence():
    path = CONFIG / 'bearing_tracker.yaml'
    own = demo_section(path)
    built = scenario.build({**from_file(path), **own.parameters})
    run = closed_loop.run(built, regulator(built)[0].gain, 0.75 * own.duration, 0)
    std = np.sqrt(np.trace(run.covariance[:, :2, :2], axis1=1, axis2=2))
    assert std[0] > 1500.0
    assert std[-1] < 0.05 * std[0]
    assert np.linalg.norm((run.truth - run.estimate)[-1, :2]) < 4.0 * std[-1]
    assert np.abs(run.input).max() < 0.05  # what a ship can do, in m/s^2


@pytest.mark.slow
def test_a_run_in_real_time_with_an_estimate_per_reading_is_judged_as_one_per_step():
    built = scenario.build({'model': 'level'})
    run = closed_loop.run(built, None, 40.0, 1)
    some = slice(0, None, 10)
    names = ('time', 'truth', 'estimate', 'covariance', 'input')
    sparse = replace(run, **{name: getattr(run, name)[some] for name in names})
    assert all(check.passed for check in judge(built, sparse).checks)
    whole = average_nees(built, run).variance
    assert average_nees(built, sparse).variance == pytest.approx(whole, rel=0.2)
