# SPDX-License-Identifier: Apache-2.0
"""The noise of an inertial sensor as a person gets it from a recording."""

import json

import numpy as np
import pytest

pytest.importorskip('rclpy')

from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu, JointState

from kalman_ros.bags.reading import Bag
from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.codecs.messages import write_stamp
from kalman_ros.programs.allan import program as allan
from kalman_ros.programs.allan.channels import channels

PERIOD = 10_000_000
STD = np.array([0.01, 0.02, 0.03, 0.1, 0.2, 0.3])


@pytest.fixture
def bag(tmp_path):
    """6000 readings of an IMU at rest, with a gap after the first 1000 and a NaN before."""
    rng = np.random.default_rng(4)
    message, name = Imu(), 'sensor_msgs/msg/Imu'
    with RecordingWriter(tmp_path / 'bag') as writer:
        writer.add('/imu/data', name)
        writer.add('/joint_states', 'sensor_msgs/msg/JointState')
        for k in range(6000):
            time = 10**18 + PERIOD * (k if k < 1000 else k + 50)
            write_stamp(message.header.stamp, time)
            row = rng.normal([0.0, 0.0, 0.0, 0.0, 0.0, 9.81], STD)
            for part, values in zip(
                (message.angular_velocity, message.linear_acceleration), row.reshape(2, 3)
            ):
                part.x, part.y, part.z = values.tolist()
            if k == 500:
                message.angular_velocity.y = float('nan')
            writer.write('/imu/data', time, bytes(serialize_message(message)))
        writer.write('/imu/data', time + 1, b'\0\1\0\0')
        writer.write('/joint_states', time, bytes(serialize_message(JointState())))
    return tmp_path / 'bag'


@pytest.mark.slow
def test_a_topic_with_an_imu_is_found_and_its_noise_printed(bag, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '80')
    out = tmp_path / 'out'
    allan.main([str(bag), '--out', str(out)])
    printed = capsys.readouterr().out
    assert '/imu/data: 5000 readings, 100 Hz, 50 s' in printed
    assert 'used, 5000 of 5999 readings; gaps: 2.' in printed
    assert 'Messages that cannot be decoded, or are not finite: 2.' in printed
    assert 'do not determine the bias instability of gyro x' in printed
    tables = printed.partition('For a parameter file')[0]
    assert max(map(len, tables.splitlines())) <= 80
    found = json.loads((out / 'summary.json').read_text())['/imu/data']
    assert found['rate'] == pytest.approx(100.0)
    density = [each['density'] for each in found['channels'].values()]
    for each, std in zip(density, STD):
        assert each['low'] < std * 0.1 < each['high']
    values = ', '.join(f'{each["value"] * 10.0:.3g}' for each in density[:3])
    assert f'noise: [{values}]   # rad/s: gyro x, gyro y, gyro z' in printed
    assert (out / 'imu_data.png').stat().st_size > 10_000


def test_a_part_of_a_recording_is_read(bag):
    """Of the gaps, that of the NaN at 5 s alone, not that from 10 to 10.5 s."""
    read = channels(Bag(bag), '/imu/data', (2.0, 9.0))
    assert (len(read.values), read.gaps, read.whole) == (400, 1, 700)
    assert read.period == pytest.approx(0.01)


@pytest.mark.slow
def test_an_empty_part_is_refused_in_one_line(bag, capsys):
    with pytest.raises(SystemExit) as end:
        allan.main([str(bag), '--from', '5', '--to', '5'])
    assert end.value.code == 2
    assert 'expected 0 <= start < end, got 5 and 5' in capsys.readouterr().err


@pytest.mark.thorough
@pytest.mark.slow
def test_noise_that_is_not_determined_has_no_line(tmp_path, capsys):
    message = Imu()
    noise = np.random.default_rng(4).normal(0.0, STD, (500, 6))
    noise[:, 0] = np.sin(0.02 * np.arange(500))  # a motion without noise
    with RecordingWriter(tmp_path / 'bag') as writer:
        writer.add('/imu', 'sensor_msgs/msg/Imu')
        for k, row in enumerate(noise.reshape(-1, 2, 3)):
            write_stamp(message.header.stamp, 10**18 + PERIOD * k)
            for part, values in zip((message.angular_velocity, message.linear_acceleration), row):
                part.x, part.y, part.z = values.tolist()
            writer.write('/imu', 10**18 + PERIOD * k, bytes(serialize_message(message)))
    allan.main([str(tmp_path / 'bag'), '--out', str(tmp_path / 'out')])
    lines = capsys.readouterr().out.partition('For a parameter file\n')[2].splitlines()
    assert lines[0] == '# no noise in rad/s: gyro x not determined'
    assert lines[1].startswith('noise: [') and '# m/s^2' in lines[1]


@pytest.mark.parametrize(
    ('topic', 'message'),
    [
        ('imu/dat', 'allan: topic: the recording has no topic /imu/dat; did you mean'),
        ('joint_states', 'expected sensor_msgs/msg/Imu on /joint_states, recorded is'),
    ],
)
def test_what_is_no_imu_is_refused_in_one_line(bag, topic, message, capsys):
    with pytest.raises(SystemExit) as exit:
        allan.main([str(bag), topic])
    assert exit.value.code == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert printed.count('\n') == 1


def test_a_recording_without_an_imu_names_what_it_has(tmp_path, capsys):
    with RecordingWriter(tmp_path / 'bag') as writer:
        writer.add('/joint_states', 'sensor_msgs/msg/JointState')
        writer.write('/joint_states', 1, bytes(serialize_message(JointState())))
    with pytest.raises(SystemExit):
        allan.main([str(tmp_path / 'bag')])
    assert 'has no topic with sensor_msgs/msg/Imu; it has /joint_states' in capsys.readouterr().err
