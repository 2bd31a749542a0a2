# SPDX-License-Identifier: Apache-2.0
"""Commands in a recording: Twist, which has no stamp, and TwistStamped; and when they cease."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message

from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.bags.replay import replay
from kalman_ros.codecs.messages import write_stamp

START, STEP = 1_700_000_000_000_000_000, 20_000_000
SPEED, TURN = 0.6, 0.4
STAMPED = {
    'input.type': 'geometry_msgs/TwistStamped',
    'input.fields': ['twist.linear.x', 'twist.angular.z'],
}


def recorded(folder, kind, until=4.0):
    """Write 4 s of commands until a time, and one reading of the wheels every second."""
    with RecordingWriter(folder) as writer:
        writer.add('/odom', 'nav_msgs/msg/Odometry')
        writer.add('/cmd_vel', f'geometry_msgs/msg/{kind.__name__}')
        for k in range(200):
            time = START + k * STEP
            if k * STEP * 1e-9 < until:
                message = kind()
                twist = message.twist if kind is TwistStamped else message
                twist.linear.x, twist.angular.z = SPEED, TURN
                if kind is TwistStamped:
                    write_stamp(message.header.stamp, time)
                writer.write('/cmd_vel', time, bytes(serialize_message(message)))
            if k % 50 == 49:
                odometry = Odometry()
                write_stamp(odometry.header.stamp, time)
                odometry.twist.covariance[[0, 35]] = 1e6, 1e6  # they say nothing
                writer.write('/odom', time, bytes(serialize_message(odometry)))
    return folder


def ended(bag, values=None):
    drive = {
        'model': 'diff_drive', 'sensors': ['odometry'], 'model_parameters.command_time': 0.1,
        **(values or {}),
    }  # fmt: skip
    return replay(bag, drive)


@pytest.mark.parametrize(('kind', 'values'), [(Twist, {}), (TwistStamped, STAMPED)])
def test_commands_move_the_estimate(tmp_path, kind, values):
    found = ended(recorded(tmp_path / 'a', kind), values)
    x, y, v, psi, omega = found.beliefs.mean[-1]
    assert (v, omega) == pytest.approx((SPEED, TURN), abs=1e-3)
    assert psi == pytest.approx(TURN * (3.98 - 0.1), abs=1e-2)
    radius = SPEED / TURN
    assert (x, y) == pytest.approx((radius * np.sin(psi), radius * (1.0 - np.cos(psi))), abs=0.06)
    assert len(found.inputs.value) == 200


def test_a_robot_stops_when_commands_cease(tmp_path):
    bag = recorded(tmp_path / 'a', Twist, until=1.0)
    held = ended(bag).beliefs.mean[-1]
    stopped = ended(bag, {'input_timeout': 0.5}).beliefs.mean[-1]
    assert held[2] == pytest.approx(SPEED, abs=1e-3)
    assert stopped[2] == pytest.approx(0.0, abs=1e-3)
    # the commands lasted 0.98 s, and 0.5 s more; the lag is the same at both ends
    assert stopped[3] == pytest.approx(TURN * 1.48, abs=1e-3)
