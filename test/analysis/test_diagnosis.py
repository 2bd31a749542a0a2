"""Causes are found in recordings with one thing wrong, and nothing in clean ones."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from thorough import mostly_thorough
from tools.strangers.injected.cases import TABLE
from tools.strangers.injected.recordings import Injection, recorded, stamps_of, values_of

from kalman_ros.analysis.diagnosis import diagnose as diagnose_module
from kalman_ros.analysis.diagnosis import gross, stamps, units
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.evidence import misfit
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.analysis.diagnosis.finding import Finding
from kalman_ros.core import rotations
from kalman_ros.scenario import build

pytestmark = pytest.mark.slow

SCENARIO = 'mass_spring_damper'


def found_in(injection, seconds=12.0, seed=5, scenario=SCENARIO):
    return diagnose(recorded(scenario, injection, seconds, seed)).findings


def rounded(y):
    return np.round(y / 0.2) * 0.2


FAULTS = {
    'losses': Injection({'position': {'dropout': 0.3}}),
    'losses in bursts': Injection({'velocity': {'burst_loss': 0.03, 'burst_length': 12.0}}),
    'delay': Injection({'position': {'delay': 1.5}}),
    'jitter': Injection({'velocity': {'jitter': 2.0}}),
    'stamps duplicated': Injection({'position': {'duplication': 0.1}}),
    'stamps backward': Injection({'position': {'reordering': 0.05}}),
    'not a number': Injection({'position': {'nan': 0.1}}),
    'frozen': Injection({'position': {'freeze': True, 'fault_window': [4.0, 6.0]}}),
    'outliers': Injection({'position': {'outliers': 0.05}}),
    'bias': Injection({'position': {'bias': [0.5]}}),
    'sign': Injection(edits={'velocity': values_of(lambda y: -y)}),
    'unit': Injection(edits={'position': values_of(lambda y: 1000.0 * y)}),
    'clock offset': Injection(edits={'velocity': stamps_of(lambda t: t + 0.3)}),
    'clock drift': Injection(edits={'velocity': stamps_of(lambda t: t + 2e-3 * (t - 1000.0))}),
    'stamps zero': Injection(edits={'position': stamps_of(lambda t: 0.0 * t)}),
    'quantised': Injection(edits={'position': values_of(rounded)}),
    'noise too small': Injection(plant={'position.noise': [0.25]}),
    'noise too large': Injection(estimator={'velocity.noise': [2.0]}),
    'process noise too small': Injection(plant={'model_parameters.force_noise': 3.0}),
    'process noise too large': Injection(estimator={'model_parameters.force_noise': 5.0}),
    'initial belief too narrow': Injection(estimator={'initial_std': [0.03, 0.05]}),
    'disturbance': Injection(body={'disturbance_amplitude': [1.5], 'disturbance_frequency': 0.9}),
}


#: Kinds that meet the other steps of the search.
MORE = [
    'losses in bursts', 'jitter', 'stamps backward', 'frozen', 'unit', 'clock offset', 'quantised',
    'noise too large', 'process noise too small', 'stamps zero', 'delay', 'outliers',
    'disturbance', 'initial belief too narrow', 'process noise too large',
]  # fmt: skip


@pytest.mark.parametrize('kind', mostly_thorough(FAULTS, *(FAULTS.keys() - MORE)))
def test_the_right_cause_comes_first(kind):
    findings = found_in(FAULTS[kind])
    assert findings, 'nothing was found'
    assert findings[0].kind == kind, [(f.kind, f.subject, f.gain) for f in findings]


@pytest.mark.parametrize(('kind', 'size'), [('delay', 0.1), ('jitter', 0.1)])
def test_a_delay_by_which_nothing_is_lost_is_a_note(kind, size):
    found = diagnose(recorded(SCENARIO, Injection({'position': {kind: size}}), 12.0, 5))
    assert (found.findings, [(note.kind, note.subject) for note in found.notes]) == (
        (),
        [(kind, 'position')],
    )


@pytest.mark.parametrize('seed', range(4))
def test_nothing_is_found_in_a_clean_recording(seed):
    assert found_in(None, seconds=8.0, seed=seed) == ()


@pytest.mark.thorough
@pytest.mark.parametrize(
    'scenario', mostly_thorough(['diff_drive', 'mass_spring_damper_2d'], 'mass_spring_damper_2d')
)
def test_a_reading_of_something_else_is_unrelated(scenario):
    case = next(c for c in TABLE if (c.label, c.system) == ('unrelated', scenario))
    [first, *_] = found_in(case.injection, 20.0, 7, scenario)
    assert (first.kind, first.subject) == ('unrelated', case.subject)
    assert first.change == {f'{case.subject}.enabled': False}


@pytest.mark.thorough
def test_two_faults_are_both_found():
    both = FAULTS['outliers'] + FAULTS['clock offset']
    kinds = [finding.kind for finding in found_in(both)]
    assert {'outliers', 'clock offset'} <= set(kinds[:4])


@pytest.mark.thorough
def test_a_delay_beside_outliers_is_no_offset_of_a_clock():
    late = Injection({'imu': {'outliers': 0.03, 'delay': 0.05}})
    found = found_in(late, 20.0, scenario='gnss_imu')
    assert [(each.kind, each.subject) for each in found] == [('outliers', 'imu')]


@pytest.mark.parametrize('fault', ['duplication', 'reordering'])
def test_stamps_that_are_put_right_by_the_estimator_explain_nothing(fault):
    (found,) = found_in(Injection({'position': {fault: 0.05}}))
    assert found.kind.startswith('stamps')
    assert found.gain == 0.0


def test_the_proof_is_a_replay_with_the_change():
    evidence = recorded(SCENARIO, FAULTS['noise too small'], 12.0, 5)
    first = diagnose(evidence).findings[0]
    gain = misfit(evidence) - misfit(evidence.rerun(first.change))
    assert first.proof == pytest.approx(gain)
    assert gain > 100.0
    assert first.change['position.noise'][0] == pytest.approx(0.25, rel=0.2)


@pytest.mark.parametrize(('proof', 'kept'), [(-29.0, True), (-31.0, False), (np.nan, True)])
def test_the_first_finding_is_doubted_if_its_replay_fits_worse(proof, kept):
    first = Finding('bias', 'gyro', 'It is off.', 9.0, {'gyro.bias': 1.0}, certainty=0.9)
    second = replace(first, subject='wheels', proof=-1e4)
    doubted = diagnose_module._doubted((replace(first, proof=proof), second))
    assert (bool(doubted[0].change), doubted[0].certainty) == (kept, 0.9 if kept else 0.3)
    assert ('fits worse' in doubted[0].sentence) is not kept
    assert doubted[1] == second  # it may need the change of the first one
    assert diagnose_module._doubted(()) == ()


def test_a_cause_found_in_turn_comes_before_what_its_noise_had_hidden():
    """Where noise that is too large is reduced in between, gains grow."""
    kinds = [('stamps rounded', 50.0), ('rotated', 100.0), ('noise too large', 900.0),
             ('bias', 300.0), ('scale', 20.0)]  # fmt: skip
    findings = [Finding(kind, 'gyro', '', 9.0, gain=gain) for kind, gain in kinds]
    ranked = diagnose_module._rank(findings, slice(1, None))
    assert [each.kind for each in ranked] == [
        'rotated', 'bias', 'stamps rounded', 'scale', 'noise too large'
    ]  # fmt: skip
    assert diagnose_module._rank(findings)[0].kind == 'bias'


def test_a_delay_of_the_sensor_of_the_best_cause_is_tried():
    """A linearisation promises little of one that is long beside the motion."""
    added = []
    best = Finding('lag', 'gyro', '', 9.0, gain=100.0)
    trials = SimpleNamespace(
        tried={('stamps early', 'gyro'): best},
        add_nearer=lambda finding, after: added.append(finding),
    )
    late = replace(
        best, kind='stamps late', gain=21.0, mended=lambda: recorded(SCENARIO, None, 2.0, 1)
    )
    others = [
        replace(late, gain=19.0),
        replace(late, kind='scale'),
        replace(late, subject='wheels'),
        replace(late, kind='stamps early'),
    ]
    diagnose_module._try_beside(best, [*others, late], trials)
    assert added == [late]


@pytest.mark.parametrize(('bottom', 'changed'), [(0.0, True), (-40.0, False)])
def test_a_scale_of_what_has_another_zero_is_no_row_of_a_matrix(bottom, changed):
    """A sounder reads the height above a bottom; C x is zero at the surface."""
    parameters = {
        'model': 'linear', 'model_parameters.states': ['z', 'v'], 'sensors': ['sounder'],
        'sounder.kind': 'tools.strangers.second.models:Sounder', 'sounder.bottom': bottom,
        'sounder.type': 'sensor_msgs/Range', 'sounder.fields': ['range'], 'sounder.noise': [0.1],
    }  # fmt: skip
    evidence = SimpleNamespace(parameters=parameters, scenario=build(parameters))
    assert bool(units.mixing(evidence, 'sounder', np.array([[0.96]]))) is changed


@pytest.mark.thorough
def test_shares_add_up():
    findings = found_in(FAULTS['outliers'] + FAULTS['sign'])
    assert sum(finding.share for finding in findings) == pytest.approx(1.0)


@pytest.mark.parametrize('value', [0.0, -1.0, 1e9])
def test_covariances_that_cannot_be_meant(value):
    def edit(readings):
        R = np.full((len(readings.value), 1, 1), value)
        return replace(readings, covariance=R)

    diagnosis = diagnose(recorded(SCENARIO, Injection(edits={'position': edit}), 6.0, 1))
    # zero is how messages say that they do not know: no fault, since the configuration is taken
    findings = diagnosis.notes if value == 0.0 else diagnosis.findings
    kind = {0.0: 'covariance zero', -1.0: 'covariance negative', 1e9: 'covariance absurd'}[value]
    assert kind in [finding.kind for finding in findings]
    change = next(finding.change for finding in findings if finding.kind == kind)
    assert change == {'position.covariance_from': 'configuration'}


def test_states_that_nothing_observes_are_notes():
    found = diagnose(recorded('diff_drive', None, 8.0, 2))
    assert found.findings == ()
    assert [note.subject for note in found.notes] == ['x', 'y', 'psi']


def test_a_sensor_without_readings():
    def nothing(readings):
        return replace(readings, received=np.zeros(0), stamp=np.zeros(0), value=np.zeros((0, 1)))

    findings = found_in(Injection(edits={'velocity': nothing}), seconds=6.0)
    assert ('no readings', 'velocity') in [(f.kind, f.subject) for f in findings]


@pytest.mark.thorough
@pytest.mark.parametrize('sensor', ['position', 'velocity'])
def test_a_sensor_of_which_nothing_is_a_number_comes_first(sensor):
    """Before what its absence, or another fault, makes of the other one."""
    other = {'position': 'velocity', 'velocity': 'position'}[sensor]
    wrong = Injection(
        {other: {'outliers': 0.05}}, edits={sensor: values_of(lambda y: np.full_like(y, np.nan))}
    )
    first, second, *_ = found_in(wrong)
    assert (first.kind, first.subject) == ('not a number', sensor)
    assert (second.kind, second.subject) == ('outliers', other)


@pytest.mark.thorough
def test_what_explains_next_to_nothing_is_not_proven():
    both = Injection({'position': {'outliers': 0.05}}, plant={'position.noise': [0.09]})
    large = Injection(edits={'velocity': values_of(lambda y: 57.0 * y)})
    findings = diagnose(recorded(SCENARIO, both + large, 12.0, 5)).findings
    small = [finding for finding in findings if finding.change and finding.share < 0.01]
    assert small
    assert not any(np.isfinite(finding.proof) for finding in small)
    assert np.isfinite(findings[0].proof)


@pytest.mark.thorough
@pytest.mark.parametrize('degrees', [60.0, 90.0, 180.0])
def test_a_vector_of_three_axes_that_is_turned_far_is_found_by_what_the_others_predict(degrees):
    turn = np.radians(degrees) * np.array([0.6, 0.0, 0.8])
    askew = Injection(edits={'odometry': values_of(lambda y: y @ rotations.exp(turn).T)})
    found = gross.find(Examination(recorded('robot_3d', askew, 12.0, 1)))
    assert (found[0].kind, found[0].subject) == ('rotated', 'odometry')
    # the readings as they would have been
    as_meant = recorded('robot_3d', Injection(), 12.0, 1).sensors['odometry'].value
    mended = found[0].mended().sensors['odometry'].value
    assert np.abs(mended - as_meant).max() < 0.1 * np.abs(as_meant).max()
    words = found[0].sentence.partition('mount.rotation: [')[2].partition(']')[0]
    mount = np.array([float(each) for each in words.split(', ')])
    assert rotations.compose(rotations.from_euler(mount), turn) == pytest.approx(0.0, abs=0.1)


def test_a_rate_that_no_one_declared_is_a_note():
    for declared in (True, False):
        evidence = recorded(SCENARIO, None, 6.0, 1)
        parameters = {k: v for k, v in evidence.parameters.items() if k != 'position.rate'}
        if declared:
            parameters['position.rate'] = 10.0
        evidence = replace(
            evidence, parameters=parameters, scenario=build({**parameters, 'position.rate': 10.0})
        )
        diagnosis = diagnose(evidence)
        assert ('rate' in [finding.kind for finding in diagnosis.findings]) == declared
        assert ('rate' in [note.kind for note in diagnosis.notes]) != declared


def test_a_type_without_a_stamp_is_a_note_and_zero_stamps_a_finding():
    evidence = recorded(SCENARIO, None, 6.0, 1)
    record = evidence.sensors['position']
    bare = replace(record, stamp=record.received, stamped=np.zeros(len(record), dtype=bool))
    evidence = evidence.with_sensor('position', bare)
    for headerless in (frozenset(), frozenset({'position'})):
        found = stamps.find(Examination(replace(evidence, headerless=headerless), strict=False))
        zero = [finding for finding in found if finding.kind == 'stamps zero']
        assert [finding.note for finding in zero] == [bool(headerless)]


def test_stamps_that_are_rounded_while_the_receipt_is_regular():
    evidence = recorded(SCENARIO, None, 6.0, 1)
    record = evidence.sensors['position']
    every = 0.0333 * np.arange(len(record))
    regular = replace(record, stamp=every, received=every + 0.004)
    coarse = replace(regular, stamp=np.round(every, 2))
    blocks = replace(coarse, received=0.5 * np.ceil(2.0 * every) + 1e-5 * np.arange(len(every)))
    for sensor, expected in ((regular, []), (coarse, ['stamps rounded']), (blocks, [])):
        found = stamps.find(Examination(evidence.with_sensor('position', sensor), strict=False))
        assert [finding.kind for finding in found if finding.kind == 'stamps rounded'] == expected


def test_a_sensor_that_is_read_once_in_a_minute_is_compared_without_a_lag():
    from kalman_ros.analysis.diagnosis.unrelated import _largest_correlation

    evidence = recorded(SCENARIO, None, 6.0, 1)
    record = evidence.sensors['position']
    seldom = replace(record, stamp=60.0 * np.arange(len(record)))
    y = np.sin(np.arange(len(record)))
    assert _largest_correlation(seldom, y[:, np.newaxis], y[:, np.newaxis]) == pytest.approx(
        1.0, abs=0.05
    )
