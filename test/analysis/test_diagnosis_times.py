# SPDX-License-Identifier: Apache-2.0
"""Stamps of sensors whose rate the model does not know, as of a yaw rate that walks at random."""

from dataclasses import replace

import pytest
from thorough import thorough
from tools.strangers.injected.recordings import recorded

from kalman_ros.analysis.diagnosis import lateness
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.analysis.diagnosis.hypotheses import walks
from kalman_ros.analysis.diagnosis.passage import explained

SENSORS = 'odometry', 'imu'


@pytest.fixture(scope='module')
def robot():
    return recorded('diff_drive', None, 15.0, 3)


def later(evidence, name, tau):
    """Return a recording in which a sensor is stamped, and received, ``tau`` seconds later."""
    record = evidence.sensors[name]
    moved = replace(record, stamp=record.stamp + tau, received=record.received + tau)
    return evidence.with_sensor(name, moved)


def seconds(finding):
    return float(finding.sentence.partition('the state ')[2].split()[0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'tau'), [('imu', 0.1), ('imu', -0.06), ('odometry', 0.25), ('odometry', -0.07)]
)
def test_a_time_is_found_by_passes_of_the_filter(robot, name, tau):
    case = Examination(later(robot, name, tau))
    found = {finding.subject: finding for finding in lateness.hidden(case)}
    finding, other = found[name], found[next(each for each in SENSORS if each != name)]
    assert finding.kind == ('stamps late' if tau > 0.0 else 'stamps early')
    assert other.kind != finding.kind  # the other one is as much out of step
    assert seconds(finding) == pytest.approx(abs(tau), abs=0.015)
    assert finding.gain == pytest.approx(other.gain, rel=0.1) and finding.gain > 30.0
    assert finding.change == {f'{name}.stamp_offset': pytest.approx(-tau, abs=0.015)}
    # what it promises, its correction explains
    after = Examination(finding.mended()).passage
    assert explained(case.passage, after) == pytest.approx(finding.gain, rel=0.1)


@pytest.mark.slow
def test_a_part_is_enough(robot, monkeypatch):
    case = Examination(later(robot, 'imu', 0.25))
    (whole,) = [found for found in lateness.hidden(case) if found.subject == 'imu']
    monkeypatch.setattr(lateness, '_PART', 1000)
    (part,) = [found for found in lateness.hidden(case) if found.subject == 'imu']
    assert seconds(part) == pytest.approx(seconds(whole), abs=0.02)
    assert part.gain == pytest.approx(whole.gain, rel=0.35)


@pytest.mark.slow
def test_a_time_beyond_the_regression_of_a_known_rate_is_found():
    spring = recorded('mass_spring_damper', None, 20.0, 3)
    found = lateness.hidden(Examination(later(spring, 'position', 1.5)))
    best = max(found, key=lambda finding: finding.gain)
    assert (best.kind, best.subject) == ('stamps late', 'position')
    assert seconds(best) == pytest.approx(1.5, abs=0.05)


@pytest.mark.slow
def test_right_stamps_are_not_doubted(robot):
    assert lateness.hidden(Examination(robot)) == []


def test_few_readings_are_left_to_the_regression(robot, monkeypatch):
    case = Examination(later(robot, 'imu', 0.1))
    monkeypatch.setattr(lateness, '_FEWEST', 10**6)
    assert lateness.hidden(case) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'tau'), [('imu', 0.1), thorough('odometry', 0.1), thorough('imu', 0.2)]
)
def test_the_doctor_names_it_first(robot, name, tau):
    first = diagnose(later(robot, name, tau)).findings[0]
    causes = {(first.kind, first.subject), *first.same_as}
    assert ('stamps late', name) in causes
    assert first.certainty > 0.5
    assert seconds(first) == pytest.approx(tau, abs=0.015)


@pytest.mark.slow
def test_a_time_far_beyond_a_linearisation_is_found(robot):
    case = Examination(later(robot, 'odometry', 0.8))
    best = max(lateness.hidden(case), key=lambda finding: finding.gain)
    assert (best.kind, best.subject) == ('stamps late', 'odometry')
    assert seconds(best) == pytest.approx(0.8, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'tau', 'least'), [thorough('cart_pole', 0.1, 0.9), ('mass_spring_damper', 1.5, 0.5)]
)
def test_an_input_that_is_stamped_late_is_found(name, tau, least):
    given = recorded(name, None, 20.0, 3)
    moved = replace(
        given.inputs, stamp=given.inputs.stamp + tau, received=given.inputs.received + tau
    )
    first = diagnose(replace(given, inputs=moved), proofs=False).findings[0]
    assert (first.kind, first.subject) == ('stamps late', 'input')
    assert first.change == {'input.stamp_offset': pytest.approx(-tau, abs=0.05)}
    assert 's before its stamps' in first.sentence and first.certainty > least


@pytest.mark.slow
def test_the_model_has_no_rate_of_what_walks_at_random(robot):
    spring = recorded('mass_spring_damper', None, 10.0, 3)
    assert walks(robot, Examination(robot).passage, 'imu')
    assert not walks(spring, Examination(spring).passage, 'position')


@pytest.mark.parametrize(('far', 'longest'), [(False, 0.09), (True, 2.43)])
def test_times_up_to_a_tenth_of_a_second_are_tried_where_the_filter_fits(far, longest):
    tried, search = [], object.__new__(lateness.TimeSearch)
    search._longest = 5.0

    def gain(tau):
        tried.append(abs(tau))
        return 0.0

    search.gain = gain
    assert search.likeliest(0.01, far) is None
    assert max(tried) == pytest.approx(longest)
