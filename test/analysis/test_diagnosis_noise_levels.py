# SPDX-License-Identifier: Apache-2.0
"""Noise that is changed in turn is compared with what was declared, not with what was tried."""

import numpy as np
import pytest
from tools.doctor_score.recordings import Injection, recorded

from kalman_ros.analysis.diagnosis import noise_levels
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.finding import Finding, NoiseLevel


@pytest.fixture(scope='module')
def evidence():
    """Return a recording of a robot whose odometry declares (.02, .05, .05) m/s."""
    return recorded('robot_3d', seconds=3.0)


def changed(indices, before, after, gain):
    level = NoiseLevel('odometry', indices, np.array(before), np.array(after), 0.05)
    return Finding('noise too ?', '?', '?', 3.0, gain=gain, level=level)


def stated(findings):
    return [(each.kind, each.subject, each.gain) for each in findings]


def test_one_change_stays_as_it_is(evidence):
    findings = [changed([0, 1, 2], [0.02, 0.05, 0.05], [0.002, 0.005, 0.005], 90.0)]
    assert noise_levels.restated(evidence, findings) == findings


def test_what_was_made_too_small_in_turn_is_still_declared_too_large(evidence):
    findings = noise_levels.restated(evidence, [
        changed([0, 1, 2], [0.02, 0.05, 0.05], [0.002, 0.005, 0.005], 90.0),
        Finding('bias', 'imu', 'readings of imu are off', 4.0, gain=40.0),
        changed([1], [0.002, 0.005, 0.005], [0.002, 0.01, 0.005], 20.0),
    ])  # fmt: skip
    assert stated(findings) == [
        ('noise too large', 'odometry', 90.0),
        ('bias', 'imu', 40.0),
        ('noise too large', 'odometry.vy', 20.0),
    ]
    whole, _, single = (each.sentence for each in findings)
    assert 'by a factor of 10 ' in whole and 'vy' not in whole and 'vx [m/s] 0.002' in whole
    assert 'by a factor of 5 (' in single and 'vy [m/s] 0.01.' in single


def test_a_change_that_others_replace_adds_its_gain_to_the_next_of_its_sensor(evidence):
    findings = noise_levels.restated(evidence, [
        changed([0, 1, 2], [0.02, 0.05, 0.05], [0.004, 0.01, 0.01], 90.0),
        changed([2], [0.004, 0.01, 0.01], [0.004, 0.01, 0.2], 20.0),
        changed([0, 1], [0.004, 0.01, 0.2], [0.002, 0.001, 0.2], 10.0),
    ])  # fmt: skip
    assert stated(findings) == [
        ('noise too small', 'odometry.vz', 110.0), ('noise too large', 'odometry', 10.0),
    ]  # fmt: skip
    assert 'by factors of 10 to 50' in findings[1].sentence


@pytest.mark.slow
def test_no_line_of_a_diagnosis_contradicts_what_the_file_declares():
    declared = [0.4, 0.4, 0.4]  # where (.02, .05, .05) is true
    evidence = recorded('robot_3d', Injection(estimator={'odometry.noise': declared}), 30.0)
    levels = [each for each in diagnose(evidence, proofs=False).findings if each.level]
    assert len(levels) > 1
    for finding in levels:
        assert finding.kind == 'noise too large', finding.sentence
    covered = sorted(index for each in levels for index in each.level.indices)
    assert covered == [0, 1, 2]
