# SPDX-License-Identifier: Apache-2.0
"""What messages contain cannot control the terminal of a log, nor fill it."""

import pytest

pytest.importorskip('rclpy')

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import serialize_message

from kalman_ros.harness.domain import Domain
from kalman_ros.nodes.controller.node import ControllerNode
from kalman_ros.nodes.estimator.node import EstimatorNode

#: Clears the screen, then forges a line.
HOSTILE = '\x1b[2J\n[INFO] [node]: all is well \u202e'


@pytest.fixture
def start():
    """Build nodes in a private domain."""
    domain, built = Domain(), []
    rclpy.init(domain_id=domain.id)

    def start(kind):
        built.append(kind())
        return built[-1]

    yield start
    for node in built:
        node.destroy_node()
    rclpy.shutdown()
    domain.close()


def publish(node, topic, message, times=1):
    """Hand a message over to a node, as if it had been received."""
    (found,) = (each for each in node.subscriptions if each.topic_name == topic)
    for _ in range(times):
        found.pass_on(serialize_message(message))


def goal(frame):
    """Return a goal in a frame."""
    message = PoseStamped()
    message.header.frame_id = frame
    return message


@pytest.mark.parametrize('level', ['info', 'warning', 'error'])
def test_a_logged_message_is_one_printable_line(start, capfd, level):
    getattr(start(ControllerNode).get_logger(), level)(f'frame {HOSTILE}')
    (line,) = (line for line in capfd.readouterr().err.split('\n') if 'frame' in line)
    assert line.isprintable()
    assert line.endswith(r'frame \x1b[2J\n[INFO] [node]: all is well \u202e')


def test_messages_of_two_lines_of_code_have_rates_of_their_own(start, capfd):
    log = start(ControllerNode).get_logger()
    log.info('first', throttle_duration_sec=60.0)
    log.info('second', throttle_duration_sec=60.0)
    said = capfd.readouterr().err
    assert 'first' in said
    assert 'second' in said


def test_a_goal_that_is_refused_is_reported_once_in_a_second(start, capfd):
    publish(start(ControllerNode), '/goal', goal(HOSTILE), 100)
    said = capfd.readouterr().err
    assert said.count('goal: expected the frame') == 1
    assert '\x1b' not in said


def test_frames_that_differ_do_not_fill_the_log(start, capfd):
    node = start(ControllerNode)
    for number in range(100):
        publish(node, '/goal', goal(f'{number} ' * 100_000))
    assert len(capfd.readouterr().err) < 100_000


def test_a_status_is_printable_and_short(start, monkeypatch):
    node, sent = start(EstimatorNode), []
    monkeypatch.setattr(node.diagnostics._publisher, 'publish', sent.append)
    frames = {'found': HOSTILE, 'long': 'x' * 1_000_000}
    monkeypatch.setattr(node.diagnostics, '_report', lambda: (*node.report()[:2], frames))
    node.diagnostics.publish()
    (array,) = sent
    assert isinstance(array, DiagnosticArray)
    values = {each.key: each.value for each in array.status[0].values}
    assert values['found'].isprintable()
    assert len(values['long']) <= 2000
    assert array.status[0].message.isprintable()
