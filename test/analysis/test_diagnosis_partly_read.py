# SPDX-License-Identifier: Apache-2.0
"""An IMU that is turned about the vertical, and of which the file reads the axis ahead alone."""

from dataclasses import replace

import numpy as np
import pytest
from tools.strangers.injected.recordings import recorded

from kalman_ros.analysis.diagnosis import partly_read
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.scenario import build, shipped
from kalman_ros.scenario.parameter_files import from_file

NOISE = 0.05


def turned(angle, *, with_vector=True):
    """Return a drive in curves whose IMU is turned by an angle in rad."""
    evidence = recorded('gnss_imu', None, 60.0, 3)
    record, beliefs = evidence.sensors['imu'], evidence.beliefs
    state = evidence.scenario.model.state
    v, w = (
        np.interp(record.stamp, beliefs.time, beliefs.mean[:, state.names.index(name)])
        for name in ('v', 'omega')
    )
    left = v * w + NOISE * np.random.default_rng(5).normal(size=len(v))
    ahead, rest = record.value[:, 0], record.value[:, 1:]
    sensed = np.cos(angle) * ahead + np.sin(angle) * left
    across = np.cos(angle) * left - np.sin(angle) * ahead

    def rerun(changes, seconds=np.inf):
        if not with_vector:
            raise ValueError('no such field')
        (_, _, yaw) = changes['imu.mount.rotation']
        level = np.cos(yaw) * sensed - np.sin(yaw) * across
        return evidence.with_values('imu', np.column_stack((level, rest)))

    changed = evidence.with_values('imu', np.column_stack((sensed, rest)))
    return replace(changed, rerun=rerun)


@pytest.mark.slow
@pytest.mark.parametrize('angle', [0.06, -0.1])
def test_it_is_found_with_its_angle(angle):
    case = Examination(turned(angle))
    (finding,) = partly_read.find(case)
    assert finding.change['imu.mount.rotation'] == pytest.approx([0.0, 0.0, angle], abs=0.02)
    after = Examination(finding.mended())
    assert case.passage.misfit - after.passage.misfit > 0.7 * finding.gain > 70.0


@pytest.mark.slow
def test_it_is_the_first_finding(monkeypatch):
    monkeypatch.setenv('KALMAN_ROS_ARITHMETIC', 'compiled')
    (finding, *_) = diagnose(turned(0.2), proofs=False).findings
    assert (finding.kind, finding.subject) == ('rotated', 'imu')
    assert finding.change['imu.mount.rotation'] == pytest.approx([0.0, 0.0, 0.2], abs=0.02)


@pytest.mark.slow
def test_one_that_is_not_turned_is_not_found():
    assert not list(partly_read.find(Examination(turned(0.0))))


@pytest.mark.slow
def test_without_the_other_axis_there_is_nothing_to_compare():
    assert not list(partly_read.find(Examination(turned(0.2, with_vector=False))))
    evidence = turned(0.2)
    known = evidence.sensors['imu'].value
    for factor in (1.0, 0.0):
        other = replace(
            evidence, rerun=lambda *_, f=factor: evidence.with_values('imu', f * known)
        )
        assert not list(partly_read.find(Examination(other)))

    def nearly_zero(changes, seconds=np.inf):
        return evidence.with_values('imu', 6e-17 * changes['imu.mount.rotation'][2] * known)

    assert not list(partly_read.find(Examination(replace(evidence, rerun=nearly_zero))))


@pytest.mark.parametrize(
    ('fields', 'indices'),
    [
        (['linear_acceleration.x', 'angular_velocity.z'], [0]),
        (['angular_velocity.z', 'linear_acceleration.y'], [1]),
        (['linear_acceleration.x', 'linear_acceleration.y'], []),
        (['pose.position.x', 'angular_velocity.z'], []),
        (['linear_acceleration.z', 'orientation.yaw'], []),
    ],
)
def test_which_coordinates_are_one_of_two_level_axes(fields, indices):
    parameters = {**from_file(shipped.file('gnss_imu'), 'estimator'), 'imu.fields': fields}
    source = build(parameters, with_law=False).sensors['imu']
    assert partly_read._indices(source) == indices
