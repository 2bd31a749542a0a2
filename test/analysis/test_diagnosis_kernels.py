"""What the diagnosis computes with, against brute force."""

from dataclasses import replace

import numpy as np
import pytest
from tools.strangers.injected.array_replay import replay
from tools.strangers.injected.recordings import Injection, recorded

from kalman_ros.analysis.diagnosis import outliers
from kalman_ros.analysis.diagnosis.bias import courses_of
from kalman_ros.analysis.diagnosis.evidence import misfit
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.analysis.diagnosis.filter_pass import passage, rejected
from kalman_ros.analysis.diagnosis.hypotheses import held
from kalman_ros.analysis.diagnosis.passage import explained
from kalman_ros.analysis.diagnosis.quantisation import grid
from kalman_ros.analysis.diagnosis.refilter import misfits
from kalman_ros.analysis.diagnosis.responses import Responses, fitted
from kalman_ros.analysis.diagnosis.stamps import slope
from kalman_ros.analysis.records import InputRecord
from kalman_ros.linear import single
from kalman_ros.linear.single import gain

SCENARIO = 'mass_spring_damper'


@pytest.fixture(scope='module')
def case():
    return Examination(recorded(SCENARIO, seconds=6.0, seed=4))


def shifted(evidence, name, offset):
    record = evidence.sensors[name]
    return evidence.with_sensor(name, replace(record, value=record.value + offset))


def test_a_pass_in_order_has_the_innovations_of_the_online_estimator(case):
    """As long as readings are received in the order of their stamps, and of the sensors."""
    readings = {
        name: (record.stamp + 1e-6 * order, record.stamp, record.value, None)
        for order, (name, record) in enumerate(case.evidence.sensors.items(), start=1)
    }
    inputs = replace(case.evidence.inputs, received=case.evidence.inputs.stamp + 1e-5)
    online = replay(case.evidence.parameters, readings, inputs)
    for name, record in online.sensors.items():
        events = [case.passage.events[i] for i in case.passage.of(name)]
        order = [event.index for event in events]
        np.testing.assert_allclose(
            [event.innovation for event in events], record.innovation[order], atol=1e-6
        )
    assert case.passage.misfit == pytest.approx(misfit(online), rel=1e-6)


def test_a_replay_has_a_belief_after_the_readings_that_were_fused():
    received = np.array([1.0, 1.1, 1.2, 1.3])
    value = np.array([[0.0], [0.0], [1e3], [0.0]])  # one is rejected
    none = InputRecord(np.zeros(0), np.zeros(0), np.zeros((0, 1)))
    parameters = {'model': SCENARIO, 'position.gate': 0.99}
    online = replay(parameters, {'position': (received, received, value, None)}, none)
    outcomes = ['FUSED', 'FUSED', 'REJECTED', 'FUSED']
    assert online.sensors['position'].outcome.tolist() == outcomes
    np.testing.assert_array_equal(online.beliefs.time, received[[0, 1, 3]])


def test_responses_predict_what_a_bias_does(case):
    """Of a linear system the first order is all: the gain is exact."""
    after = passage(shifted(case.evidence, 'position', -0.07))
    columns = case.responses.columns('offset', 'position', '0')
    g = case.responses.gradient[columns].sum()
    M = case.responses.information[np.ix_(columns, columns)].sum()
    expected = 2.0 * 0.07 * g - 0.07**2 * M
    assert explained(case.passage, after) == pytest.approx(expected, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize(
    ('subjects', 'families'),
    [
        (['position'], {'mix', 'read', 'upper', 'stamp', 'play'}),
        (['position', 'velocity'], {'mix', 'read', 'upper', 'stamp', 'play'}),
        (['mass'], {'gain', 'half', 'push', 'lag', 'dead', 'tone', 'first', 'parameter'}),
    ],
)
def test_responses_about_a_subject_are_a_part_of_all(case, subjects, families):
    part = Examination(case.evidence, known=case.passage).about(subjects).responses
    assert {label[0] for label in part.labels} - families == set()
    assert {label[1] for label in part.labels if label[0] == 'mix'} == {*subjects} - {'mass'}
    at = [case.responses.labels.index(label) for label in part.labels]
    np.testing.assert_allclose(part.gradient, case.responses.gradient[at], rtol=1e-9)
    size = np.abs(part.information).max()
    np.testing.assert_allclose(
        part.information, case.responses.information[np.ix_(at, at)], atol=1e-9 * size
    )


def test_what_is_known_is_not_computed_again(case):
    assert case.responses is case.about(['position']).responses  # it has those of all subjects
    assert Examination(case.evidence, known=case.passage).about(['f']).given is None  # an input


def test_responses_predict_what_an_input_does(case):
    inputs = case.evidence.inputs
    more = replace(case.evidence, inputs=replace(inputs, value=1.1 * inputs.value))
    (column,) = case.responses.columns('gain', 'f')
    g, M = case.responses.gradient[column], case.responses.information[column, column]
    expected = 2.0 * 0.1 * g - 0.1**2 * M
    # the input is held within steps, which the response takes to first order in their length
    assert explained(case.passage, passage(more)) == pytest.approx(expected, rel=0.02, abs=0.5)


@pytest.mark.parametrize('label', [('position', '0'), ('velocity', '0'), ('force_noise',)])
def test_scores_are_the_derivative_of_the_likelihood(case, label):
    h = 1e-3
    index = case.scores.labels.index(label)

    def at(log):
        evidence = case.evidence
        if len(label) == 1:
            return passage(evidence.adopting({'model_parameters.force_noise': 0.1 * np.exp(log)}))
        record = evidence.sensors[label[0]]
        record = replace(record, covariance=record.covariance * np.exp(log))
        return passage(evidence.with_sensor(label[0], record))

    # process noise is taken to first order in the length of a step
    slope = -0.5 * (at(h).misfit - at(-h).misfit) / (2.0 * h)
    assert case.scores.gradient[index] == pytest.approx(slope, rel=1e-2, abs=1e-2)


def test_another_noise_has_the_likelihood_of_its_own_pass(case):
    labels = case.scores.labels
    candidates = np.zeros((2, len(labels)))
    candidates[1, labels.index(('position', '0'))] = np.log(9.0)
    found = misfits(case.passage, labels, candidates, case.densities, most=10_000)
    own = passage(case.evidence.adopting({'position.noise': [0.15]}))
    assert found[0] == pytest.approx(case.passage.misfit, rel=1e-9)
    assert found[1] == pytest.approx(own.misfit, rel=1e-6)


@pytest.mark.thorough
@pytest.mark.slow
def test_noise_that_is_taken_away_leaves_the_likelihood_of_a_filter():
    """Of a chain of integrators: to first order in the step, the rest of Q would be indefinite."""
    calm = Injection(plant={'model_parameters.acceleration_noise': 0.03})
    evidence = recorded('gnss_imu', calm, 20.0, 7)
    found = Examination(evidence)
    labels = found.scores.labels
    logs = [0.0, -2.5, -6.0]
    candidates = np.zeros((3, len(labels)))
    candidates[:, labels.index(('acceleration_noise',))] = logs
    misfit = misfits(found.passage, labels, candidates, found.densities, most=10_000)
    assert misfit[0] == pytest.approx(found.passage.misfit, abs=1e-3)
    for log, promised in zip(logs, misfit):
        noise = 0.5 * np.exp(log)
        own = passage(evidence.adopting({'model_parameters.acceleration_noise': noise}))
        assert promised == pytest.approx(own.misfit, abs=0.15 * abs(misfit[1] - misfit[0]))


def test_a_gate_lists_what_is_far(case):
    record = case.evidence.sensors['position']
    value = record.value.copy()
    value[[20, 50, 70]] += 3.0
    spoilt = case.evidence.with_sensor('position', replace(record, value=value))
    assert rejected(spoilt, 'position', 25).tolist() == [20, 50, 70]
    assert rejected(spoilt, 'position', 1e9).tolist() == []


def test_directions_without_information_stay_at_zero():
    fit = fitted(np.array([2.0, 0.0]), np.diag([4.0, 0.0]))
    np.testing.assert_allclose(fit.size, [0.5, 0.0])
    assert fit.gain == pytest.approx(1.0)


def course(values, std=1.0):
    """Return the kind of course that is found in pieces with these values."""
    B = len(values)
    information = np.eye(B) / std**2
    labels = [('offset', 's', '0', str(b)) for b in range(B)]
    found = Responses(labels, information @ np.asarray(values), information)
    courses = courses_of(found, {0: list(range(B))})
    return courses[0].kind if courses else 'none'


def test_courses_are_told_apart():
    rng = np.random.default_rng(3)
    t = np.arange(30)
    noise = rng.standard_normal(30)
    assert course(noise) == 'none'
    assert course(5.0 + noise) == 'constant'
    assert course(0.5 * t + noise) == 'ramp'
    assert course(9.0 * (t > 12) + noise) == 'step'
    walk = np.cumsum(rng.standard_normal(30))
    assert course(4.0 * walk + noise) == 'walk'
    # nearly all of it is a ramp, and what is left is far more than chance
    assert course(10.0 * t + 20.0 * walk + noise) == 'walk'


def test_the_pass_of_a_filter_that_fails_ends_there(case, monkeypatch):
    calls = []

    def failing(P, H, R):
        calls.append(P)
        return gain(P, H, R if len(calls) % 50 else -R - 1e9)

    monkeypatch.setattr(single, 'gain', failing)
    with pytest.raises(np.linalg.LinAlgError, match='not positive definite'):
        passage(case.evidence)
    assert len(passage(case.evidence, strict=False).events) == 49


def test_the_step_of_quantised_values():
    rng = np.random.default_rng(1)
    values = rng.standard_normal(500)
    assert grid(values) is None
    assert grid(np.round(values / 0.3) * 0.3) == pytest.approx(0.3)


def test_a_slope_is_not_moved_by_outliers():
    t = np.arange(100.0)
    y = 2.0 * t
    y[::7] += 1e4
    assert slope(t, y) == pytest.approx(2.0)


def test_the_input_before_a_time_is_the_last_with_an_earlier_stamp():
    stamps, values = np.array([1.0, 2.0]), np.array([5.0, 7.0])
    times = np.array([0.5, 1.0, 1.1, 2.0, 2.1, 9.0])
    assert held(stamps, values, times).tolist() == [5.0, 5.0, 5.0, 5.0, 7.0, 7.0]
    assert held(stamps[:0], values[:0], times).tolist() == [0.0] * 6


def test_outliers_are_the_readings_far_off_and_the_picture_shows_their_limit(case):
    record = case.evidence.sensors['position']
    wrong = [20, 45, 90]
    value = record.value.copy()
    value[wrong] += 50.0
    evidence = case.evidence.with_sensor('position', replace(record, value=value))
    (finding,) = outliers.find(Examination(evidence))
    assert finding.subject == 'position'
    assert finding.sentence.startswith(f'3 of {len(value)} readings of position')
    mended = finding.mended().sensors['position'].value
    assert np.flatnonzero(np.isnan(mended)).tolist() == wrong
    squares, limit = finding.figure.curves
    assert squares.x.shape == squares.y.shape == (len(value),)
    assert limit.x.tolist() == [squares.x[0], squares.x[-1]]
    assert np.ptp(limit.y) == 0.0
    assert limit.y.shape == (2,)
    assert np.count_nonzero(squares.y > limit.y[0]) >= 3
