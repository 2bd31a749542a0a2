# SPDX-License-Identifier: Apache-2.0
"""Two estimators of one parameter file: odom to base_link, and map to odom (REP-105)."""

import importlib.util
from itertools import count
from math import atan2, cos, hypot, sin

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from terminals import Terminals

from kalman_ros.codecs.messages import nanoseconds, write_stamp

INSTALLED = importlib.util.find_spec('tf2_msgs') is not None
ROBOT = """\
/**:
  ros__parameters:
    model: robot_2d
    odometry: {kind: states, measures: [vx, vy, wz], topic: odom, type: nav_msgs/Odometry,
               fields: [twist.twist.linear.x, twist.twist.linear.y, twist.twist.angular.z],
               noise: [0.02, 0.05, 0.1]}
    publish_tf: true

/**/estimator:
  ros__parameters:
    sensors: [odometry]
    frame: odom
    child_frame: base_link
    publish_odometry: true
    initial_estimate: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]

/**/estimator_map:
  ros__parameters:
    sensors: [position, odometry]
    position: {kind: states, measures: ['x', 'y'], topic: position, noise: [0.1, 0.1],
               type: geometry_msgs/PoseWithCovarianceStamped,
               fields: [pose.pose.position.x, pose.pose.position.y]}
    frame: map
    state: {topic: global/estimate}
    odom_frame: odom
    initial_estimate: [20.0, 10.0, 1.57, 0.0, 0.0, 0.0, 0.0, 0.0]
"""
SPEED, TURN = 1.0, 0.3


def after(seconds):
    """Return where the robot is in the map, which begins at (20, 10) and faces north."""
    a = TURN * seconds
    forward, left = SPEED / TURN * sin(a), SPEED / TURN * (1.0 - cos(a))
    return 20.0 - left, 10.0 + forward


@pytest.mark.real_time
@pytest.mark.skipif(not INSTALLED, reason='tf2_msgs is not installed')
def test_the_transforms_of_both_lead_from_the_map_to_the_robot(tmp_path):
    from tf2_msgs.msg import TFMessage

    file = tmp_path / 'robot.yaml'
    file.write_text(ROBOT)
    transforms, estimates = {}, {}

    def keep(message):
        for each in message.transforms:
            at = each.transform.translation, each.transform.rotation
            pose = at[0].x, at[0].y, 2.0 * atan2(at[1].z, at[1].w)
            frames = each.header.frame_id, each.child_frame_id
            transforms.setdefault(frames, {})[nanoseconds(each.header.stamp)] = pose

    def keep_estimate(message):
        estimates[nanoseconds(message.header.stamp)] = list(message.position)

    with Terminals('--ros-args', '--params-file', str(file)) as nodes:
        nodes.node.create_subscription(TFMessage, '/tf', keep, 1000)
        nodes.node.create_subscription(JointState, 'global/estimate', keep_estimate, 1000)
        wheels = nodes.node.create_publisher(Odometry, 'odom', 100)
        places = nodes.node.create_publisher(PoseWithCovarianceStamped, 'position', 100)
        nodes.start('estimator')
        nodes.start('map', '-r', '__node:=estimator_map', program='estimator')
        ready = lambda: wheels.get_subscription_count() == 2 and places.get_subscription_count()  # noqa: E731
        nodes.wait(ready, 30.0, lambda: 'no subscribers')
        begin = nodes.node.get_clock().now().nanoseconds

        number = count()

        def drive():
            now = nodes.node.get_clock().now().nanoseconds
            message = Odometry()
            write_stamp(message.header.stamp, now)
            message.twist.twist.linear.x, message.twist.twist.angular.z = SPEED, TURN
            wheels.publish(message)
            if next(number) % 5 == 0:
                place = PoseWithCovarianceStamped()
                write_stamp(place.header.stamp, now)
                position = place.pose.pose.position
                position.x, position.y = after((now - begin) * 1e-9)
                places.publish(place)

        pairs = {('odom', 'base_link'), ('map', 'odom')}

        def enough():
            drive()
            return {*transforms} >= pairs and all(len(transforms[each]) > 200 for each in pairs)

        nodes.wait(enough, 30.0, lambda: {k: len(v) for k, v in transforms.items()})
    assert {*transforms} == pairs
    local, world = transforms['odom', 'base_link'], transforms['map', 'odom']
    assert len({*world} & {*estimates}) > 100
    known = np.array(sorted(local))
    for stamp in sorted({*world} & {*estimates})[-100:]:
        x, y, yaw = world[stamp]
        a, b, turned = local[int(known[np.argmin(np.abs(known - stamp))])]
        at = x + cos(yaw) * a - sin(yaw) * b, y + sin(yaw) * a + cos(yaw) * b
        expected = estimates[stamp]
        assert hypot(at[0] - expected[0], at[1] - expected[1]) < 0.1
        assert abs(sin(0.5 * (yaw + turned - expected[2]))) < 0.05
        assert hypot(*np.subtract(expected[:2], after((stamp - begin) * 1e-9))) < 0.5
