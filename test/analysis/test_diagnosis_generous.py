# SPDX-License-Identifier: Apache-2.0
"""Causes that hide behind generous noise."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tools.strangers.injected.recordings import recorded

from kalman_ros.analysis.diagnosis import generous, noise_levels, unrelated
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.analysis.diagnosis.passage import DROPPED, Passage
from kalman_ros.analysis.diagnosis.peak import deviation, peak
from kalman_ros.core import Space


@pytest.fixture(scope='module', autouse=True)
def compiled():
    """Compute as users do: a pass in numpy takes twenty times as long."""
    pytest.importorskip('casadi', reason='passes in C need CasADi')
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('KALMAN_ROS_ARITHMETIC', 'compiled')
        yield


@pytest.fixture(scope='module')
def robot():
    """Return a recording of a robot, the noise of which is declared 20 times too large."""
    evidence = recorded('diff_drive', None, 30.0, 3)
    for name, record in evidence.sensors.items():
        generously = replace(record, covariance=400.0 * record.covariance)
        evidence = evidence.with_sensor(name, generously)
    return evidence


def wrong(evidence, name, index, factor):
    column = factor * evidence.sensors[name].value[:, index]
    return evidence.with_column(name, index, column)


def passage(whitened, log=0.0, rows=None):
    """Return a pass with these whitened innovations (N, k) of one sensor."""
    rows = range(len(whitened)) if rows is None else rows
    events = [
        SimpleNamespace(sensor='y', index=row, time=0.0, log=log, S=np.eye(whitened.shape[1]))
        for row in rows
    ]
    return Passage(events, list(whitened))


def test_a_factor_of_all_covariances_gains_nothing():
    e = np.random.default_rng(0).normal(size=(500, 2))
    log_size = 2.0 * np.log(9.0)  # of S that is 9 times as large, for e that is a third
    assert generous.gain(passage(e), passage(e / 3.0, log_size)) == pytest.approx(0.0, abs=1e-6)
    # half of the errors of one of two coordinates, with the same S
    smaller = generous.gain(passage(e), passage(e * [0.5, 1.0]))
    assert smaller == pytest.approx(500 * np.log(4.0))
    difference = generous.misfit(passage(e)) - generous.misfit(passage(e * [0.5, 1.0]))
    assert difference == pytest.approx(smaller)


def test_outliers_and_their_omission_gain_little():
    rng = np.random.default_rng(1)
    e = rng.normal(size=(500, 1))
    spoiled = e.copy()
    spoiled[::50] = 1e3
    assert abs(generous.gain(passage(e), passage(spoiled))) < 250.0  # 5,000 without a limit
    kept = [row for row in range(500) if row % 50]
    omitted = generous.gain(passage(e), passage(e[kept], rows=kept))
    assert omitted == pytest.approx(-10 * DROPPED, abs=10.0)


def test_readings_that_are_mostly_zero_have_no_outliers():
    e = np.zeros((100, 1))
    e[:10] = 2.0
    assert generous._mean_squares(e) == pytest.approx(0.4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'index', 'factor', 'cause'),
    [
        ('odometry', 1, -1.0, ('sign', 'odometry.omega')),
        ('imu', 0, 0.5, ('scale', 'imu.omega')),
        ('imu', 0, -0.4, ('sign', 'imu.omega')),
    ],
)
def test_a_factor_is_found_behind_generous_noise(robot, name, index, factor, cause):
    case = Examination(wrong(robot, name, index, factor))
    assert case.passage.mean_square < 0.5  # nothing looks wrong
    found = generous.find(case, ())
    assert (found.kind, found.subject) == cause
    words = found.sentence.partition('multiplied by ')[2].split()[0]
    assert float(words.rstrip(':')) == pytest.approx(1.0 / factor, rel=0.1)
    assert 0.3 < found.certainty <= 0.8
    assert found.is_exact and found.gain > 1000.0


@pytest.mark.slow
def test_a_recording_that_is_right_has_no_such_cause(robot):
    assert generous.find(Examination(robot), ()) is None
    exact = recorded('diff_drive', None, 30.0, 3)
    assert not generous._is_generous(Examination(exact).passage)
    assert generous.find(Examination(wrong(exact, 'odometry', 1, -1.0)), ()) is None


@pytest.mark.slow
def test_noise_that_leaves_smaller_errors_comes_first(robot):
    case = Examination(wrong(robot, 'imu', 0, 0.5))
    noise = noise_levels.find(case)
    found = generous.find(case, noise)
    assert (found.kind, found.subject) == ('scale', 'imu.omega')

    def perfect():
        right = recorded('diff_drive', None, 30.0, 3)
        return right.without('imu', slice(0))

    better = replace(noise[0], mended=perfect)
    assert generous.find(case, [better]).kind == noise[0].kind


@pytest.mark.slow
def test_the_doctor_names_it_first(robot):
    found = diagnose(wrong(robot, 'imu', 0, 0.5)).findings
    assert (found[0].kind, found[0].subject) == ('scale', 'imu.omega')
    assert any(finding.kind == 'noise too large' for finding in found)


@pytest.mark.slow
def test_quarter_turns_are_those_of_vectors(robot):
    assert not list(generous._quarter_turns(Examination(robot), 'odometry'))  # m/s and rad/s
    space = recorded('robot_3d', None, 2.0, 3)
    found = list(generous._quarter_turns(Examination(space), 'odometry'))
    value = space.sensors['odometry'].value
    turns = {np.round(each.mended().sensors['odometry'].value[5], 9).tobytes() for each in found}
    assert len(found) == len(turns) == 9 and {each.kind for each in found} == {'rotated'}
    for each in found:
        after = each.mended().sensors['odometry'].value
        np.testing.assert_allclose(np.linalg.norm(after, axis=1), np.linalg.norm(value, axis=1))


def test_many_coordinates_of_one_unit_are_not_permuted(monkeypatch):
    """Twelve joints have 479,001,600 orders."""
    joints = SimpleNamespace(output=Space(tuple('abcdefghijkl'), ('rad',) * 12))
    scenario = SimpleNamespace(sensors={'joints': SimpleNamespace(sensor=joints)})
    case = SimpleNamespace(
        judged=['joints'], evidence=SimpleNamespace(scenario=scenario),
        passage=passage(np.zeros((3, 12))),
    )  # fmt: skip
    for name in ('_scale', '_time', '_quarter_turns'):
        monkeypatch.setattr(generous, name, lambda *_: [])
    monkeypatch.setattr(generous.input_axes, 'by_passes', lambda *_: [])
    assert not list(generous._candidates(case, None))


def test_a_scale_without_a_peak_is_none(robot):
    errors = SimpleNamespace(gain=lambda evidence: 50.0, count=lambda name: 100)
    assert not list(generous._scale(Examination(robot), errors, 'imu', (0,)))


@pytest.mark.slow
def test_a_sensor_that_reads_nothing_and_is_believed_is_unrelated():
    evidence = recorded('diff_drive', None, 30.0, 3)
    nothing = 0.01 * np.random.default_rng(1).normal(size=(len(evidence.sensors['imu']), 1))
    case = Examination(evidence.with_values('imu', nothing))
    doubted = [name for name in case.judged if unrelated._is_suspect(case, name)]
    assert doubted == ['odometry']  # which is right
    (found,) = unrelated.find(case)
    assert found.subject == 'imu' and found.gain > 1000.0
    assert unrelated.find(Examination(evidence)) == []


def test_the_peak_of_a_parabola_and_its_deviation():
    def gain(x):
        return 50.0 - ((x - 1.3) / 0.2) ** 2

    low, best, high = peak(gain, 0.5, 1.0, 2.0)
    assert low < 1.3 < high and best == pytest.approx(1.3, abs=0.05)
    assert deviation(gain, low, 1.3, high) == pytest.approx(0.2)
    assert deviation(lambda x: 0.0, 0.0, 1.0, 2.0) == pytest.approx(1e6)  # flat
