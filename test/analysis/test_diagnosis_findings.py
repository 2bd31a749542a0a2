# SPDX-License-Identifier: Apache-2.0
"""Single findings of a diagnosis, and the pass of a filter that they look at."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from examined import record
from tools.strangers.injected.recordings import recorded

from kalman_ros.analysis.diagnosis import inputs, noise_levels, rate
from kalman_ros.analysis.diagnosis.diagnose import divided
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.analysis.diagnosis.filter_pass import passage
from kalman_ros.analysis.diagnosis.finding import Finding
from kalman_ros.analysis.records import InputRecord


@pytest.fixture(scope='module')
def evidence():
    return recorded('mass_spring_damper', seconds=6.0, seed=4)


def commanded(evidence, stamps):
    """Return the evidence with an input of 3 from each of some stamps on."""
    stamps = np.array(stamps)
    record = InputRecord(stamps, stamps, np.full((len(stamps), 1), 3.0))
    return replace(evidence, inputs=record)


@pytest.mark.slow
def test_what_is_added_to_an_input_is_added_while_it_acts(evidence):
    """Its course has one value a piece of the recording, each about its middle."""
    stamps, value = evidence.inputs.stamp, evidence.inputs.value
    read = np.concatenate([record.stamp for record in evidence.sensors.values()])
    begin, end = read.min(), read.max()
    half = 0.5 * (begin + end)
    spoilt = replace(
        evidence, inputs=replace(evidence.inputs, value=value - 4.0 * (stamps > half)[:, None])
    )
    (finding,) = (
        f for f in inputs.find(Examination(spoilt)) if f.kind == 'disturbance' and f.figure
    )
    (course,) = finding.figure.curves
    added = (finding.mended().inputs.value - spoilt.inputs.value)[:, 0]
    inside = (begin < stamps) & (stamps < end)
    nearest = np.abs((stamps[inside] - begin)[:, None] - course.x).argmin(axis=1)
    np.testing.assert_array_equal(added[inside], course.y[nearest])
    piece = course.x[1] - course.x[0]
    assert np.abs(added[inside & (stamps < half - piece)]).max() < 1.5
    np.testing.assert_allclose(added[inside & (stamps > half + piece)], 4.0, atol=1.5)


def gaps(evidence, received):
    """Return the findings where of the readings at 0, 0.1, 0.2 s and so on only some are there."""
    record = evidence.sensors['position'].select(np.zeros(len(received), dtype=int))
    stamps = 0.1 * np.array(received)
    record = replace(record, stamp=stamps, received=stamps)
    found = rate.find(Examination(evidence.with_sensor('position', record)))
    return [f.kind for f in found if f.subject == 'position' and f.kind.startswith('losses')]


@pytest.mark.parametrize(
    ('received', 'kinds'),
    [
        # half are lost: by chance alone, two in a row on average
        ([0, 1, 2, 3, 4, 5, 6, 7], []),
        ([0, 1, 2, 3, 8, 9, 10, 15], ['losses']),
        ([0, 1, 2, 3, 8, 9, 10, 16], ['losses in bursts']),
        # three in a row are too few to tell
        ([*range(20), 23], ['losses']),
        ([*range(20), 24], ['losses in bursts']),
    ],
)
def test_losses_are_bursts_where_more_than_twice_as_many_are_in_a_row_as_by_chance(
    evidence, received, kinds
):
    assert gaps(evidence, received) == kinds


@pytest.mark.parametrize(('count', 'note'), [(2, False), (3, True)])
def test_landmarks_are_seen_now_and_then_if_one_of_them_is(count, note):
    """One is there for a fifth of the time, the others for more than half of it."""
    received = [[*range(10), *range(40, 50)], *[[*range(30), *range(36, 50)]] * (count - 1)]
    sensors, sources = {}, {}
    for index, times in enumerate(received):
        stamps = 0.1 * np.array(times)
        sensors[f'mark{index}'] = record(stamps, value=np.sin(stamps))
        sensor = SimpleNamespace(output=SimpleNamespace(units=('m', 'rad')))
        sources[f'mark{index}'] = SimpleNamespace(sensor=sensor, timed=SimpleNamespace(rate=10.0))
    scenario = SimpleNamespace(sensors=sources, enabled=sources)
    case = SimpleNamespace(
        evidence=SimpleNamespace(sensors=sensors, scenario=scenario, parameters={})
    )
    losses = {each.subject: each for each in rate.find(case) if each.kind.startswith('losses')}
    assert losses['mark0'].note
    assert losses['mark1'].note is note


@pytest.mark.slow
def test_a_factor_of_noise_that_no_peak_shows_is_at_least_the_largest_trial(evidence):
    """Where the likelihood only grows, with the noise as large as any that is tried."""
    believed = evidence.adopting({'position.noise': [1e-5], 'model_parameters.force_noise': 10.0})
    record = believed.sensors['position']
    swing = 100.0 * np.sin(3.0 * record.stamp)[:, None]
    swinging = replace(record, value=record.value + swing)
    case = Examination(believed.with_sensor('position', swinging))
    (finding,) = (f for f in noise_levels.find(case) if f.subject == 'position.x')
    assert finding.kind == 'noise too small'
    (factor,) = re.search(r'by a factor of at least (\S+):', finding.sentence).groups()
    assert float(factor) == pytest.approx(np.exp(0.5 * 9.6), rel=5e-3)


@pytest.mark.parametrize(
    ('rests', 'stamps', 'moves'),
    [
        (True, [], True),
        (True, [0.5], True),
        (True, [2.0], False),
        (False, [2.0], True),
        (False, [], True),
    ],
)
def test_a_body_that_rests_until_an_input_does_not_rest_where_there_is_none(
    evidence, rests, stamps, moves
):
    parameters = {**evidence.parameters, 'rest_until_input': rests}
    given = commanded(replace(evidence, parameters=parameters), stamps)
    record = evidence.sensors['position']
    given = replace(given, sensors={'position': record.select(slice(0, 3))})
    given = given.with_sensor(
        'position', replace(given.sensors['position'], stamp=np.array([0.0, 1.0, 3.0]))
    )
    steps = [event.F for event in passage(given).events]
    assert np.array_equal(steps[1], np.eye(len(steps[1]))) != moves
    assert not np.array_equal(steps[2], np.eye(len(steps[2])))


@pytest.mark.parametrize('count', [1, 2])
def test_a_recording_of_one_reading_has_the_densities_of_any(evidence, count):
    few = evidence
    for name, readings in evidence.sensors.items():
        few = few.with_sensor(name, readings.select(slice(0, count if name == 'position' else 0)))
    found, expected = Examination(few), Examination(evidence)
    assert len(found.passage.events) == count
    np.testing.assert_allclose(found.densities['force_noise'], expected.densities['force_noise'])


@pytest.mark.parametrize(('certainty', 'noted'), [(0.0099, True), (0.01, False)])
def test_a_cause_of_next_to_no_certainty_is_a_note(certainty, noted):
    cause = Finding('bias', 'gyro', 'the gyro is off', 5.0, certainty=certainty)
    sure, notes = divided([cause])
    assert len(notes) == noted and len(sure) != noted
    assert not noted or (notes[0].note and 'less than 1 % sure' in notes[0].sentence)
