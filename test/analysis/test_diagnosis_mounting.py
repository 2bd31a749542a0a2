# SPDX-License-Identifier: Apache-2.0
"""Sensors that are turned as a whole, axes that couple, and the axes of a filter that is lost."""

from dataclasses import replace

import numpy as np
import pytest
from tools.strangers.injected.array_replay import replay

from kalman_ros.analysis.diagnosis import alignment, gross, mounting
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.analysis.records import InputRecord
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.turned_codec import TurnedCodec
from kalman_ros.core import Signal, rotations
from kalman_ros.core.mount import Mounting

STEP, STEPS, G = 0.05, 240, 9.80665
IMU = [f'{kind}.{axis}' for kind in ('angular_velocity', 'linear_acceleration') for axis in 'xyz']
POSE = [*(f'pose.position.{axis}' for axis in 'xyz'), *(f'pose.orientation.r{i}' for i in 'xyz')]
ROBOT = {
    'model': 'robot_3d', 'filter': 'ekf', 'rate': 1.0 / STEP,
    'model_parameters.velocity_noise': [1e-4] * 3, 'model_parameters.turn_noise': [0.05] * 3,
    'model_parameters.acceleration_noise': [1e-4] * 3, 'sensors': ['imu', 'pose'],
    'imu.kind': 'imu', 'imu.type': 'sensor_msgs/Imu', 'imu.fields': IMU,
    'imu.noise': [0.01] * 3 + [0.1] * 3, 'imu.rate': 1.0 / STEP,
    'pose.measures': ['x', 'y', 'z', 'rx', 'ry', 'rz'], 'pose.type': 'geometry_msgs/PoseStamped',
    'pose.fields': POSE, 'pose.noise': [0.02] * 3 + [0.01] * 3, 'pose.rate': 1.0 / STEP,
    'initial_estimate': [0.0] * 15, 'initial_std': [0.1] * 15,
}  # fmt: skip


def turning(seed=4):
    """Return the readings of a body that turns about a fixed place."""
    rng, R, rates, attitudes = np.random.default_rng(seed), np.eye(3), [], []
    for t in STEP * np.arange(STEPS):
        w = np.array([0.5 * np.sin(t), 0.4 * np.cos(0.7 * t), 0.3])
        rates.append(w)
        attitudes.append(R)
        R = R @ rotations.exp(w * STEP)
    attitudes = np.array(attitudes)
    force = attitudes.transpose(0, 2, 1) @ np.array([0.0, 0.0, G])
    shaken = rotations.log(rotations.exp(0.01 * rng.normal(size=(STEPS, 3))) @ attitudes)
    return {
        'imu': np.hstack((rates, force)) + rng.normal(size=(STEPS, 6)) * ROBOT['imu.noise'],
        'pose': np.hstack((0.02 * rng.normal(size=(STEPS, 3)), shaken)),
    }


def evidence(values, **configured):
    stamp = 1000.0 + STEP * np.arange(STEPS)
    taken = {name: (stamp + 1e-3, stamp, value, None) for name, value in values.items()}
    nothing = InputRecord(np.zeros(0), np.zeros(0), np.zeros((0, 0)))
    return replay({**ROBOT, **configured}, taken, nothing)


TURN = np.radians([0.0, 6.0, -4.0])


@pytest.mark.slow
@pytest.mark.parametrize('name', ['imu', 'pose'])
def test_a_sensor_is_turned_as_a_whole(name):
    values = turning()
    fields = ROBOT[f'{name}.fields']
    # a sensor that is turned by B against the body reads B' v, and R B
    values[name] = alignment.aligned(fields, values[name], rotations.exp(-TURN))
    found = diagnose(evidence(values), proofs=False).findings[0]
    assert (found.kind, found.subject) == ('rotated', name)
    B = rotations.exp(rotations.from_euler(np.array(found.change[f'{name}.mount.rotation'])))
    np.testing.assert_allclose(rotations.log(B), TURN, atol=np.radians(0.8))
    values[name] = alignment.aligned(fields, values[name], B)
    assert Examination(evidence(values)).passage.mean_square < 1.1


@pytest.mark.slow
def test_the_mounting_adds_to_a_known_one():
    values, known = turning(), np.radians([0.0, 0.0, 30.0])
    fields = ROBOT['imu.fields']
    values['imu'] = alignment.aligned(fields, values['imu'], rotations.exp(-TURN))
    case = Examination(evidence(values, **{'imu.mount.rotation': known.tolist()}))
    (found,) = mounting._find_misaligned(case, 'imu')
    B = rotations.exp(rotations.from_euler(np.array(found.change['imu.mount.rotation'])))
    turned = B @ rotations.exp(-known)
    np.testing.assert_allclose(rotations.log(turned), TURN, atol=np.radians(1.0))


def test_readings_are_aligned_as_the_estimator_aligns_them():
    fields, value = (*POSE[3:], *IMU), np.hstack((turning()['pose'][7, 3:], turning()['imu'][7]))
    for used, of in ((fields[:3], 'geometry_msgs/PoseStamped'), (fields[3:], 'sensor_msgs/Imu')):
        signal = Signal('topic', of, used)
        y = value[[fields.index(field) for field in used]]
        mount = Mounting(tuple(rotations.to_euler(TURN).tolist()), placed=True)
        message = SignalCodec(signal).encode(0, y)
        decoded = TurnedCodec(replace(signal, mounting=mount)).decode(message)
        turned = alignment.aligned(used, y[None], rotations.exp(TURN))[0]
        np.testing.assert_allclose(turned, decoded, atol=1e-12)


def test_places_stay_and_what_is_not_read_too():
    fields, values = (*POSE, *IMU), np.hstack((turning()['pose'], turning()['imu']))
    values[3, 4] = np.nan
    B = rotations.exp(TURN)
    turned = alignment.aligned(fields, values, B)
    np.testing.assert_array_equal(turned[:, :3], values[:, :3])
    np.testing.assert_array_equal(turned[3, 3:6], values[3, 3:6])
    np.testing.assert_allclose(turned[:, 6:9], values[:, 6:9] @ B.T)
    back = alignment.aligned(fields, turned, B.T)
    np.testing.assert_allclose(back, values, atol=1e-12)


@pytest.mark.parametrize(
    ('fields', 'alignable'),
    [(IMU, True), (POSE, True), (IMU[:3], False), (POSE[:3], False), (IMU[:2] + IMU[3:], False)],
)
def test_a_single_vector_has_a_rotation_of_its_own(fields, alignable):
    assert alignment.is_alignable(fields) is alignable


@pytest.mark.slow
def test_an_axis_that_reads_a_part_of_another_is_named():
    values = turning()
    values['imu'][:, 1] += 0.08 * values['imu'][:, 0]
    found = diagnose(evidence(values), proofs=False).findings[0]
    assert (found.kind, found.subject) == ('cross-axis', 'imu')
    words = found.sentence.split()
    assert (words[0], words[8]) == ('wy', 'wx,')
    assert float(words[4]) == pytest.approx(0.08, abs=0.01)


@pytest.mark.slow
def test_axes_of_a_lost_filter_are_exchanged():
    values = turning()
    values['imu'] = values['imu'][:, [1, 0, 2, 3, 4, 5]]
    case = Examination(evidence(values), strict=False)
    assert gross.lost(case)
    found = gross.find(case)[0]
    assert (found.kind, found.subject) == ('swapped', 'imu')
    assert 'wx is read as wy, wy is read as wx' in found.sentence
