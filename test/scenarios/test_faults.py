# SPDX-License-Identifier: Apache-2.0
"""The fault matrix over topics: what every fault does to every filter, and what holds anyway."""

import json
from dataclasses import replace

import numpy as np
import pytest
from commands import run_command

pytest.importorskip('rclpy')

from tools.faults.cases import CASES, SHORT
from tools.faults.fault_settings import SETTINGS
from tools.faults.matrix import FaultMatrix

from kalman_ros.harness import Run

FILTERS = ('kf', 'ekf', 'ukf')
NODES = ('estimator', 'controller', 'plant')
_found = {}


def findings(filter):
    """Put a filter through all cases, once."""
    if filter not in _found:
        run = FaultMatrix(filter, SHORT, seed=1).findings(CASES, lambda: None)
        _found[filter] = {found.fault: found for found in run}
    return _found[filter]


@pytest.mark.thorough
@pytest.mark.timeout(400)
@pytest.mark.parametrize('filter', FILTERS)
def test_what_is_promised_under_every_fault_holds(filter, capfd):
    found = findings(filter)
    with capfd.disabled():
        print(f'\n{filter}: seconds until the error is back within 3 deviations')
        for name, finding in found.items():
            print(f'  {name:50} {"-" if finding.recovery is None else finding.recovery}')
    assert len(found) == len(CASES) >= 20
    assert {name: finding.broken for name, finding in found.items() if finding.broken} == {}


@pytest.mark.thorough
@pytest.mark.timeout(400)
@pytest.mark.parametrize('filter', FILTERS)
def test_faults_do_what_they_are_called(filter):
    """Where there are no faults nothing is lost, and where there are, what they take is gone."""
    found = findings(filter)
    sound = found['none'].counts
    assert (sound.rejected, sound.dropped) == (0, 0)
    assert found['loss of everything'].counts.came < 0.7 * sound.came
    assert found['duplication 0.5 of both'].counts.dropped > 40
    assert found['NaN always, of position'].counts.dropped == 22  # 1.1 s at 20 Hz
    assert found['delay 1.2 s of position, beyond the window'].counts.dropped == 22
    assert found['outliers 0.3 of both, gates'].counts.rejected > 20
    assert found['jitter 0.4 s of both'].counts.fused > 0.95 * sound.fused
    honest = [f for f in found.values() if f.promise.name == 'COVERED']
    fooled = [f for f in found.values() if f.promise.name == 'WARNED']
    assert min(f.coverage for f in honest) > max(f.coverage for f in fooled)


@pytest.mark.thorough
@pytest.mark.timeout(400)
def test_the_filters_agree_as_they_must_on_a_linear_system():
    kf, *others = (findings(filter) for filter in FILTERS)
    for other in others:
        for name, finding in kf.items():
            assert other[name].counts == finding.counts, name
            np.testing.assert_allclose(other[name].max_error, finding.max_error, rtol=1e-6)


@pytest.mark.thorough
@pytest.mark.timeout(600)
@pytest.mark.parametrize('filter', ['ekf', 'ukf'])
@pytest.mark.parametrize('setting', SETTINGS[1:], ids=lambda each: each.scenario)
def test_a_robot_in_space_keeps_the_promises_too(setting, filter):
    assert filter in setting.filters
    run = FaultMatrix(filter, SHORT, 1, setting).findings(setting.cases, lambda: None)
    found = {finding.fault.partition(': ')[2]: finding for finding in run}
    assert {name: finding.broken for name, finding in found.items() if finding.broken} == {}
    sound = found['none'].counts
    assert (sound.rejected, sound.dropped) == (0, 0)
    assert found['loss of everything'].counts.came < 0.7 * sound.came
    assert found['duplication 0.5 of all'].counts.dropped > 20
    assert found['outliers 0.05 of all, gates'].counts.rejected > 0


LOCKED = next(case for case in CASES if case.name.startswith('sure of a place'))


@pytest.mark.thorough
def test_a_gate_that_locks_out_recovers_and_without_recovery_it_does_not():
    never = replace(LOCKED, estimator={**LOCKED.estimator, 'gate_recover_after': 0})
    found, locked = FaultMatrix('kf', SHORT, seed=1).findings([LOCKED, never], lambda: None)
    assert found.broken == []
    assert 0.9 <= found.recovery < 1.5  # 20 readings at 20 Hz are rejected, then it gives in
    assert locked.recovery is None
    assert locked.counts.rejected > found.counts.rejected


def estimates(order, **overrides):
    with Run(overrides=overrides, seed=5, nodes=order) as run:
        run.advance(3.0)
        return [*run.recorder.raw['estimate']], [*run.recorder.raw['position']]


@pytest.mark.thorough
def test_the_same_seed_gives_the_same_bytes_under_every_fault_at_once():
    wrong = {
        'dropout': 0.1, 'burst_loss': 0.02, 'delay': 0.03, 'jitter': 0.1, 'reordering': 0.2,
        'duplication': 0.2, 'outliers': 0.1, 'bias': [0.01], 'drift': [0.01],
        'random_walk': [0.05], 'nan': 0.05, 'gate': 0.999,
    }  # fmt: skip
    shared = {f'{name}.{key}': v for name in ('position', 'velocity') for key, v in wrong.items()}
    shared.update(actuator_loss=0.1, disturbance_noise=[0.01], actuator_dead_zone=[0.1])
    first = estimates(NODES, **shared)
    assert estimates(NODES[::-1], **shared) == first
    assert len(first[0]) == 301
    sound = estimates(NODES)
    assert sound[0] != first[0]
    assert len(sound[1]) == 61


@pytest.mark.thorough
def test_a_late_reading_keeps_its_stamp_and_the_estimate_its_time():
    with Run(overrides={'position.delay': 0.1}, nodes=NODES) as run:
        run.advance(1.0)
        stamps = run.recorder['position'].stamp
        estimate = run.recorder['estimate'].stamp
        innovations = run.recorder['estimate/innovation/position'].stamp
    np.testing.assert_array_equal(np.diff(stamps), 50_000_000)
    assert stamps[0] == estimate[0]
    assert len(stamps) == 19  # those of the last 0.1 s are under way
    np.testing.assert_array_equal(np.diff(estimate), 10_000_000)
    np.testing.assert_array_equal(innovations, stamps)


def test_faults_change_live_and_a_bad_one_is_refused():
    with Run(nodes=NODES) as run:
        run.advance(1.0)
        sound = len(run.recorder.raw['position'])
        run.set_parameter('position.dropout', 1.0)
        run.advance(1.0)
        assert len(run.recorder.raw['position']) == sound
        run.refresh('plant')
        assert 'position.dropout' in run.diagnostics['plant'].message
        with pytest.raises(ValueError, match=r'position\.dropout'):
            run.set_parameter('position.dropout', 1.5)
        with pytest.raises(ValueError, match=r'velocity\.bias: expected 1 or 2 numbers, got 3'):
            run.set_parameter('velocity.bias', [1.0, 1.0, 1.0])
        with pytest.raises(ValueError, match='disturbance_constant: expected 1 or 2 numbers'):
            run.set_parameter('disturbance_constant', [1.0, 1.0, 1.0])
        run.set_parameter('position.dropout', 0.0)
        run.advance(1.0)
        assert len(run.recorder.raw['position']) == sound + 20
        run.refresh('plant')
        assert run.diagnostics['plant'].message == 'running'


@pytest.mark.thorough
def test_the_body_may_differ_from_what_the_estimator_believes(tmp_path):
    """By the plant's own section of the parameter file."""
    path = tmp_path / 'heavy.yaml'
    path.write_text(
        '/**:\n  ros__parameters:\n    model_parameters: {mass: 1.0, force_noise: 1.0e-12}\n'
        '/**/plant:\n  ros__parameters:\n    model_parameters: {mass: 3.0}\n'
    )
    with Run(str(path), nodes=NODES) as run:
        run.advance(3.0)
        found, heavy = run.trajectory(), run.scenario.model
        run.refresh('estimator')
        warning = run.diagnostics['estimator'].message
    step = heavy.transition(*heavy.equilibrium, 0.01)
    np.testing.assert_allclose(
        found.truth[1:], found.truth[:-1] @ step.F.T + found.input[:-1] @ step.G.T, atol=1e-5
    )
    assert 'do not scatter as expected' in warning


def command(*arguments):
    """Run the command as a person does; return its exit code and what it printed."""
    code, out, err = run_command('faults', *arguments)
    return code, out + err


@pytest.mark.thorough
def test_the_command_prints_a_table_and_writes_its_results(tmp_path):
    code, printed = command(
        '--filters', 'kf', '--only', 'dropout 0', '--short', '--out', str(tmp_path)
    )
    assert code == 0, printed
    assert 'Every promise holds.' in printed
    page = (tmp_path / 'faults.md').read_text()
    assert '| dropout 0.7 of both | covered | kf |' in page
    found = json.loads((tmp_path / 'summary.json').read_text())['findings']
    assert [finding['fault'] for finding in found] == [
        'dropout 0.3 of position', 'dropout 0.7 of both'
    ]  # fmt: skip
    assert all(finding['broken'] == [] for finding in found)


@pytest.mark.parametrize(
    ('arguments', 'says'),
    [
        (['--filters', 'magic'], "faults: unknown filter 'magic'; known are kf, ekf"),
        (['--only', 'meteorite'], "faults: only: no fault has 'meteorite' in its name"),
    ],
)
def test_the_command_says_what_is_wrong(arguments, says, tmp_path):
    code, printed = command(*arguments, '--out', str(tmp_path))
    assert code == 2
    assert says in printed
