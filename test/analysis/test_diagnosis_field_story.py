"""The causes in one user's story, FusionCore issue 73, each as a recording of ours.

github.com/manankharwar/fusioncore/issues/73 and the changelogs of its versions 0.3.3 to 0.3.7.
"""

from dataclasses import replace
from math import radians

import numpy as np
import pytest
from tools.strangers.injected.recordings import Injection, recorded, stamps_of, values_of

from kalman_ros.analysis.diagnosis.diagnose import diagnose

pytestmark = pytest.mark.slow

#: A robot with wheels and a gyroscope, and a compass.
COMPASS = {
    'sensors': ['odometry', 'imu', 'compass'],
    'compass.kind': 'states',
    'compass.measures': ['psi'],
    'compass.noise': [0.02],
    'compass.rate': 20.0,
    'compass.topic': 'compass',
    'compass.type': 'sensor_msgs/Imu',
    'compass.fields': ['orientation.yaw'],
}


def findings(scenario, injection, seconds=10.0):
    found = diagnose(recorded(scenario, injection, seconds, 7)).findings
    return [(finding.kind, finding.subject) for finding in found], found


def test_an_imu_that_is_stamped_3_s_ahead():
    """Encoders looked 3 s old beside it, and the filter diverged by 10 m/s."""
    ahead = Injection(edits={'imu': stamps_of(lambda stamp: stamp + 3.0)})
    names, found = findings('diff_drive', ahead)
    assert names[0] == ('clock offset', 'imu')
    assert '3 s ahead of' in found[0].sentence


@pytest.mark.thorough
def test_a_sigma_in_metres_that_was_read_as_dop():
    """Of 6 m, as a receiver alone has it, where a DOP of 1 was believed to be metres."""
    wrong = Injection(plant={'gnss.noise': [4.0, 4.0]})
    names, found = findings('gnss_imu', wrong, seconds=20.0)
    assert names[0][0] == 'noise too small'
    assert names[0][1].startswith('gnss')
    assert max(found[0].change['gnss.noise']) == pytest.approx(4.0, rel=0.35)


def test_an_orientation_covariance_that_was_left_at_zero():
    def zero(readings):
        N, k = readings.value.shape
        return replace(readings, covariance=np.zeros((N, k, k)))

    evidence = recorded('diff_drive', Injection(edits={'imu': zero}), 5.0, 1)
    note = diagnose(evidence).notes[0]
    assert (note.kind, note.subject) == ('covariance zero', 'imu')
    assert note.change == {'imu.covariance_from': 'configuration'}


@pytest.mark.thorough
def test_a_gate_that_rejected_a_third_of_good_fixes():
    """Its bound did not know the noise of the receiver: 157 of 500 fixes were rejected."""
    tight = Injection(
        plant={'position.noise': [0.12]},
        estimator={'position.gate': 0.95, 'gate_recover_after': 0},
    )
    names, found = findings('mass_spring_damper', tight, seconds=15.0)
    assert ('gate', 'position') in names
    gate = found[names.index(('gate', 'position'))]
    assert gate.change == {'position.gate': 1.0}
    assert any(kind == 'noise too small' for kind, _ in names)


def test_a_wireless_link_that_is_slower_than_the_window():
    """A delay of the link looks like a clock that lags; the stamps are right."""
    slow = Injection({'position': {'delay': 1.5}})
    names, found = findings('mass_spring_damper', slow, seconds=8.0)
    assert names[0] == ('delay', 'position')
    assert 'dropped as older than the window' in found[0].sentence
    assert found[0].change['window'] > 1.5


@pytest.mark.thorough
def test_a_heading_that_is_20_degrees_off():
    """Every leg began with a curve of 20 degrees to one side."""
    wrong = Injection(
        plant=COMPASS,
        estimator={**COMPASS, 'initial_std': [0.01, 0.01, 0.5, 0.01, 0.5]},
        edits={'compass': values_of(lambda psi: psi + radians(20.0))},
    )
    names, found = findings('diff_drive', wrong)
    assert names[0] == ('bias', 'compass')
    assert '+0.34' in found[0].sentence or '+0.35' in found[0].sentence


@pytest.mark.thorough
def test_gravity_in_an_acceleration_by_the_tilt_of_a_mounting():
    """10 degrees of tilt leave 1.7 m/s^2, which was integrated to 170 m."""
    tilted = values_of(lambda y: y + np.array([9.81 * np.sin(radians(10.0)), 0.0]))
    names, _ = findings('gnss_imu', Injection(edits={'imu': tilted}), seconds=12.0)
    # the model has this bias as a state: it is its first belief that was too narrow
    assert names[0][0] in ('bias', 'initial belief too narrow')
