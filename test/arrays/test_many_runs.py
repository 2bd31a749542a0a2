# SPDX-License-Identifier: Apache-2.0
"""monte_carlo: statistics that a person reads, and what is refused."""

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.analysis.checks import theory


@pytest.fixture(scope='module')
def many():
    return kr.monte_carlo(runs=120, seconds=12, seed=4)


@pytest.mark.slow
def test_errors_and_cost_are_those_of_theory(many):
    expected = theory(kr.load('mass_spring_damper_2d'))
    std = np.sqrt(expected.loop.posterior.diagonal(axis1=1, axis2=2).mean(axis=0))
    np.testing.assert_allclose(many.rms, std, rtol=0.08)
    np.testing.assert_allclose(many.std, std, rtol=0.02)
    assert abs(many.cost - expected.expected_cost) < 4.0 * many.cost_error
    assert many.consistent and abs(many.anees - 1.0) < 0.05
    assert not many.lost.any() and set(many.nis) == {'position', 'velocity'}


@pytest.mark.slow
def test_a_run_again_is_simulate_with_its_seed(many):
    run = many.run(7)
    same = kr.simulate(seconds=12, seed=many.seeds[7])
    assert np.array_equal(run.truth, same.truth)
    first = round(many.after * many.scenario.rate)
    error = (run.truth - run.estimate)[first:]
    np.testing.assert_allclose(
        many.outcomes.squared_error[7], np.mean(error**2, axis=0), rtol=1e-10
    )
    with pytest.raises(IndexError, match='run: expected an index below 120, got 120'):
        many.run(120)


def test_the_repr_fits_and_says_what_is_wrong(many):
    printed = repr(many)
    assert max(map(len, printed.splitlines())) <= 79
    assert '120 runs of LinearSystem for 12 s at 100 Hz' in printed
    assert 'within' in printed and 'consistent' in printed and 'cost per second' in printed
    # a gate that rejects half of the good readings makes the filter overconfident
    wrong = kr.monte_carlo(
        'mass_spring_damper_2d', {'position.gate': 0.5}, runs=10, seconds=2, after=0.5
    )
    assert 'NOT consistent' in repr(wrong)


@pytest.mark.slow
def test_a_controller_that_is_too_weak_loses_the_pole():
    many = kr.monte_carlo('cart_pole', runs=4, seconds=3, input_limit=1.0, after=0.0)
    assert many.lost.all() and np.isnan(many.cost)
    assert '4 of 4 runs are lost' in repr(many)
    assert 'a limit changed the input' in repr(many)
    kept = kr.monte_carlo('cart_pole', runs=4, seconds=3, lost={'theta': 0.2})
    assert not kept.lost.any()


@pytest.mark.slow
def test_the_picture(many, tmp_path):
    many.plot(tmp_path / 'many.png')
    assert (tmp_path / 'many.png').stat().st_size > 10_000


def test_without_an_input_there_is_no_cost():
    many = kr.monte_carlo('constant_velocity', runs=3, seconds=2)
    assert np.isnan(many.cost) and 'cost' not in repr(many)


@pytest.mark.parametrize(
    ('options', 'says'),
    [
        ({'runs': 0}, 'runs: expected a whole number from 1, got 0'),
        ({'runs': 2.5}, 'runs: expected a whole number from 1, got 2.5'),
        ({'seed': -1}, 'seed: expected a whole number from 0, got -1'),
        ({'workers': 0}, 'workers: expected a whole number from 1, got 0'),
        ({'chunk': 0}, 'chunk: expected a whole number from 1, got 0'),
        ({'seconds': np.nan}, 'seconds: expected a positive number of seconds'),
        ({'after': 99}, 'after: expected 0 to 10 s, the duration, got 99'),
        ({'after': np.nan}, 'after: expected 0 to 10 s, the duration, got nan'),
        ({'lost': {'z': 1}}, 'lost: expected names among'),
        ({'lost': {'x': -1}}, 'lost: expected a positive error of x, got -1'),
        ({'lost': 3}, 'lost: expected errors by the name of a state, got 3'),
        ({'reference': {'z': 1}}, 'reference: expected names among'),
    ],
)
def test_what_is_refused(options, says):
    with pytest.raises(ValueError) as refused:
        kr.monte_carlo(**options)
    assert str(refused.value).startswith(says)


@pytest.mark.slow
def test_the_faults_of_a_file_are_those_of_its_plant(tmp_path):
    path = tmp_path / 'faulty.yaml'
    path.write_text(
        '/**:\n  ros__parameters:\n    model: mass_spring_damper_2d\n'
        '/**/plant:\n  ros__parameters:\n    position.dropout: 1.0\n'
    )
    many = kr.monte_carlo(path, runs=3, seconds=3)
    assert 'position' not in many.nis and np.isfinite(many.nis['velocity'])
    assert 'faults: position.dropout: 1.0' in repr(many)
    assert 'faults' not in repr(kr.monte_carlo(runs=3, seconds=3))
    one = kr.simulate(path, seconds=3, seed=many.seeds[1])
    assert not len(one.readings['position'].time)
    assert 'faults: position.dropout: 1.0' in repr(one)


def test_bad_faults_are_refused_by_name():
    with pytest.raises(ValueError, match="'position.dropuot'; did you mean 'position.dropout'"):
        kr.monte_carlo('mass_spring_damper_2d', {'position.dropuot': 0.5})
    with pytest.raises(ValueError, match=r'position\.dropout'):
        kr.simulate('mass_spring_damper_2d', {'position.dropout': 1.5})
    with pytest.raises(ValueError, match=r'position\.bias: expected 1 or 2 numbers, got 3'):
        kr.simulate('mass_spring_damper_2d', {'position.bias': [1.0, 1.0, 1.0]})
    # a fault of the plant means nothing to a filter or a design
    with pytest.raises(ValueError, match='position.dropout'):
        kr.load('mass_spring_damper_2d', {'position.dropout': 0.5})
