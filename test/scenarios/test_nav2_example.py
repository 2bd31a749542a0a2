# SPDX-License-Identifier: Apache-2.0
"""The examples for Nav2 start as their launch files say, under a manager, and give a pose."""

import re
import runpy
import sys
from math import cos, pi, sin
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import yaml

pytest.importorskip('rclpy')

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, NavSatFix
from terminals import Terminals

from kalman_ros.codecs.messages import write_stamp
from kalman_ros.core.geodesy import Place, TangentPlane

EXAMPLES = Path(__file__).parents[2] / 'docs' / 'examples' / 'nav2'
SPEED, TURN = 1.0, 0.2
PLANE = TangentPlane(Place(49.8728, 8.6512, 144.0))


def launched(name, monkeypatch):
    """Return what a launch file starts: nodes, with the arguments that they are given."""
    modules = {name: ModuleType(name) for name in ('launch', 'launch_ros', 'launch_ros.actions')}
    modules['launch'].LaunchDescription = list
    modules['launch_ros.actions'].Node = lambda **fields: SimpleNamespace(**fields)
    for module in modules.items():
        monkeypatch.setitem(sys.modules, *module)
    return runpy.run_path(str(EXAMPLES / name))['generate_launch_description']()


def arguments(node):
    """Return the command line that launch_ros gives a node."""
    (file,) = node.parameters
    words = ['--ros-args', '--params-file', file]
    if getattr(node, 'name', ''):
        words += ['-r', f'__node:={node.name}']
    for old, new in node.remappings:
        words += ['-r', f'{old}:={new}']
    return words


def messages(now, seconds):
    """Return what wheels, IMU and receiver measure of a robot that drives a circle from east."""
    heading = TURN * seconds
    wheels, imu, fix = Odometry(), Imu(), NavSatFix()
    for message in (wheels, imu, fix):
        write_stamp(message.header.stamp, now)
    wheels.child_frame_id = imu.header.frame_id = fix.header.frame_id = 'base_link'
    wheels.twist.twist.linear.x, wheels.twist.twist.angular.z = SPEED, TURN
    imu.angular_velocity.z = TURN
    imu.orientation.z, imu.orientation.w = sin(heading / 2), cos(heading / 2)
    where = PLANE.place(np.array([*place(seconds), 0.0]))
    fix.latitude, fix.longitude, fix.altitude = where
    fix.status.status = 0
    return wheels, imu, fix


def place(seconds):
    a = TURN * seconds
    return SPEED / TURN * sin(a), SPEED / TURN * (1.0 - cos(a))


@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'outputs'),
    [
        pytest.param('wheels_and_imu', {'odometry/filtered': 'odom'}, marks=pytest.mark.thorough),
        ('gnss', {'odometry/local': 'odom', 'odometry/global': 'map'}),
    ],
)
def test_the_launch_file_gives_the_topics_that_nav2_reads(name, outputs, monkeypatch):
    *nodes, manager = launched(f'{name}.launch.py', monkeypatch)
    assert (manager.package, manager.executable) == ('nav2_lifecycle_manager', 'lifecycle_manager')
    (settings,) = manager.parameters
    found = {}
    with Terminals() as terminals:
        for node in nodes:
            assert (node.package, node.executable) == ('kalman_ros', 'estimator')
            title = getattr(node, 'name', 'estimator')
            terminals.start(title, *arguments(node), program='estimator')
        for title in settings['node_names']:
            client = terminals.node.create_client(ChangeState, f'{title}/change_state')
            terminals.wait(client.service_is_ready, 60.0, lambda: 'no such node')
            for change in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
                request = ChangeState.Request(transition=Transition(id=change))
                answer = client.call_async(request)
                terminals.wait(answer.done, 60.0, lambda: 'no answer')
                assert answer.result().success, terminals.said(title)
        for topic in outputs:
            keep = lambda message, topic=topic: found.__setitem__(topic, message)  # noqa: E731
            terminals.node.create_subscription(Odometry, topic, keep, 10)
        publishers = [
            terminals.node.create_publisher(kind, topic, 100)
            for kind, topic in ((Odometry, 'odom'), (Imu, 'imu/data'), (NavSatFix, 'gps/fix'))
        ]
        needed = publishers if 'odometry/global' in outputs else publishers[:2]
        terminals.wait(
            lambda: all(each.get_subscription_count() for each in needed), 30.0, lambda: 'unheard'
        )
        start = terminals.node.get_clock().now().nanoseconds
        seconds = 0.0

        def drive():
            nonlocal seconds
            now = terminals.node.get_clock().now().nanoseconds
            seconds = (now - start) * 1e-9
            for publisher, message in zip(publishers, messages(now, seconds)):
                publisher.publish(message)
            return seconds > 3.0 and {*found} == {*outputs}

        terminals.wait(drive, 60.0, lambda: f'only {found.keys()}')
    for topic, frame in outputs.items():
        message = found[topic]
        assert (message.header.frame_id, message.child_frame_id) == (frame, 'base_link')
        pose = message.pose.pose
        at = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec - start * 1e-9
        error = np.hypot(*(np.array([pose.position.x, pose.position.y]) - place(at)))
        assert error < 0.3, (topic, error)
        turned = 2.0 * np.arctan2(pose.orientation.z, pose.orientation.w) - TURN * at
        assert abs((turned + pi) % (2 * pi) - pi) < 0.1
        assert message.twist.twist.linear.x == pytest.approx(SPEED, abs=0.1)


def test_the_names_of_the_diagnostics_are_those_that_the_analyzers_match():
    """A GenericAnalyzer takes the statuses whose name contains a word; none has a space."""
    document = yaml.safe_load((EXAMPLES / 'aggregator.yaml').read_text())
    analyzers = document['/**']['ros__parameters']['state']['analyzers']
    words = [word for each in analyzers.values() for word in each['contains']]
    for node in ('estimator', 'controller', 'monitor', 'local_estimator', 'robot1/controller'):
        assert any(word in node for word in words)
        assert not re.search(r'\s', node)
