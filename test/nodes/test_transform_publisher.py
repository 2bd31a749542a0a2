# SPDX-License-Identifier: Apache-2.0
"""When the estimator publishes transforms, and when it is silent, on a stand-in for tf2_msgs."""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from static_frames import message

from kalman_ros.core import Gaussian
from kalman_ros.nodes.estimator import transform_publisher
from kalman_ros.nodes.estimator.transform_publisher import TransformPublisher
from kalman_ros.nodes.middleware.diagnostics import Level
from kalman_ros.pipeline.settings import settings
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file

SECOND = 1_000_000_000
NOW = 100 * SECOND
GIVEN = {**from_file(shipped.file('robot_2d'), 'estimator'), 'publish_tf': True, 'frame': 'odom'}


class TFMessage:
    """A message of transforms, as tf2_msgs has it."""

    def __init__(self):
        self.transforms = []


class Node:
    """What the publisher uses of a node; messages that are published are kept."""

    def __init__(self):
        self.sent, self.said, self.now = [], [], NOW
        self.subscriptions, self.endpoints = {}, []
        self.intake = SimpleNamespace(read=lambda topic, read, data: read(data))

    def create_publisher(self, kind, topic, queue):
        assert topic == '/tf'
        return SimpleNamespace(publish=self._keep)

    def _keep(self, message):
        (transform,) = message.transforms
        to, q = transform.transform.translation, transform.transform.rotation
        frames = transform.header.frame_id, transform.child_frame_id
        stamp = transform.header.stamp.sec + 1e-9 * transform.header.stamp.nanosec
        self.sent.append((frames, stamp, (to.x, to.y, to.z), (q.x, q.y, q.z, q.w)))

    def create_subscription(self, kind, topic, callback, queue, raw):
        self.subscriptions[topic] = callback

    def get_fully_qualified_name(self):
        return '/us'

    def get_publishers_info_by_topic(self, topic):
        assert topic == '/tf'
        return self.endpoints

    def get_logger(self):
        return SimpleNamespace(warning=self.said.append)

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=self.now))


@pytest.fixture(autouse=True)
def tf2_msgs(monkeypatch):
    module = ModuleType('tf2_msgs.msg')
    module.TFMessage = TFMessage
    monkeypatch.setitem(sys.modules, 'tf2_msgs', ModuleType('tf2_msgs'))
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', module)


def built(**changes):
    known, node = settings({**GIVEN, **changes}), Node()
    publisher = TransformPublisher(node, known.scenario, known.options)
    publisher.subscribe()
    belief = known.scenario.initial_belief
    x = np.array([1.0, 2.0, np.pi / 2, 0.0, 0.0, 0.0, 0.0, 0.0])
    return node, publisher, belief._replace(mean=x)


def transform(parent, child, *numbers, time=0):
    return message((parent, child, numbers or (0.0,) * 6 + (1.0,)), time=time)


def test_the_pose_is_the_transform_from_frame_to_child_frame():
    node, publish, belief = built(tf_time_offset=0.5)
    publish(NOW, belief, NOW)
    ((frames, stamp, to, q),) = node.sent
    assert frames == ('odom', 'base_link') and stamp == pytest.approx(100.5)
    np.testing.assert_allclose((*to, *q), (1.0, 2.0, 0.0, 0.0, 0.0, 0.5**0.5, 0.5**0.5))
    assert publish.report(Level.OK, 'consistent', {})[0] is Level.OK


def test_it_is_silent_after_the_estimate_is_too_old_and_says_so():
    node, publish, belief = built(tf_timeout=0.2)
    publish(NOW, belief, None)
    assert publish.refusal == 'no reading was fused yet'
    publish(NOW, belief, NOW - 3 * SECOND // 10)
    assert publish.refusal == 'the last reading is 0.3 s old, tf_timeout is 0.2 s'
    node.now = NOW + SECOND  # the estimate itself comes late
    publish(NOW, belief, NOW)
    assert not node.sent
    assert [line[:14] for line in node.said] == ['no transform: '] * 3
    level, message, _ = publish.report(Level.OK, 'consistent', {})
    assert level is Level.WARN and message.startswith('no transform: the last')
    node.now = NOW
    publish(NOW, belief, NOW - SECOND // 10)
    assert len(node.sent) == 1 and not publish.refusal


def test_a_transform_is_never_anything_but_finite():
    node, publish, belief = built()
    for value in (np.nan, np.inf, -np.inf):
        for index in (0, 2):
            x = belief.mean.copy()
            x[index] = value
            with np.errstate(invalid='ignore'):
                publish(NOW, Gaussian(x, belief.covariance), NOW)
    assert not node.sent and node.said


def test_a_second_parent_ends_it_until_that_is_gone():
    node, publish, belief = built()
    publish._take(transform('odom', 'base_link'), static=False)  # its own
    publish(NOW, belief, NOW)
    node.now += SECOND
    publish._take(transform('map', 'base_link'), static=False)
    publish(node.now, belief, node.now)
    assert len(node.sent) == 1 and "'base_link' has the parent 'map' already" in node.said[0]
    node.now += 60 * SECOND
    publish(node.now, belief, node.now)
    assert len(node.sent) == 2
    node.subscriptions['/tf_static'](transform('base_link', 'odom'))
    publish(node.now, belief, node.now)
    assert len(node.sent) == 2 and 'a loop' in publish.refusal


def test_with_a_frame_between_it_is_the_transform_to_that():
    node, publish, belief = built(frame='map', odom_frame='odom')
    publish(NOW, belief, NOW)
    assert not node.sent
    wanted = "no transform 'odom' to 'base_link' near the time of the estimate"
    assert publish.refusal == wanted
    assert publish.report(Level.OK, 'consistent', {})[1] == f'no transform: {wanted}'
    take, pose = node.subscriptions['/tf'], (1.0, 0.0, 0.0, 0.0, 0.0, 0.5**0.5, 0.5**0.5)
    take(transform('odom', 'base_link', *pose, time=NOW))
    publish(NOW, belief, NOW)
    ((frames, _, to, q),) = node.sent
    assert frames == ('map', 'odom')
    np.testing.assert_allclose((*to, *q), (0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0), atol=1e-12)
    publish(NOW + SECOND // 2, belief, NOW + SECOND // 2)
    publish(NOW + 2 * SECOND, belief, NOW + 2 * SECOND)
    assert len(node.sent) == 2 and publish.refusal == wanted
    # it follows each message, also of many within a moment
    for k in range(10):
        moved = (float(k), *pose[1:])
        take(transform('odom', 'base_link', *moved, time=NOW + 2 * SECOND + k))
    publish(NOW + 2 * SECOND + 9, belief, NOW + 2 * SECOND)
    # the map turns against the odometry by nothing, so the places differ as the bodies do
    np.testing.assert_allclose(node.sent[-1][2], (1.0 - 9.0, 2.0, 0.0), atol=1e-12)


def test_stamps_that_are_shifted_are_those_of_both_transforms():
    """Of the place of the body, too, which another estimator with the same offset publishes."""
    node, publish, belief = built(frame='map', odom_frame='odom', tf_time_offset=0.1)
    pose = (1.0, 0.0, 0.0, 0.0, 0.0, 0.5**0.5, 0.5**0.5)
    take = node.subscriptions['/tf']
    take(transform('odom', 'base_link', 9.0, *pose[1:], time=NOW))
    take(transform('odom', 'base_link', *pose, time=NOW + SECOND // 10))
    publish(NOW, belief, NOW)
    ((_, stamp, to, _),) = node.sent
    assert stamp == pytest.approx(100.1)
    np.testing.assert_allclose(to, (0.0, 2.0, 0.0), atol=1e-12)


def test_a_rival_beside_other_transforms_is_named():
    node, publish, _ = built()
    own, other = ('odom', 'base_link', (0.0,) * 6 + (1.0,)), ('a', 'b', (0.0,) * 6 + (1.0,))
    for step in range(4):
        node.now += SECOND // 10
        node.subscriptions['/tf'](message(other, own, time=NOW + step))
    level, said, _ = publish.report(Level.OK, 'consistent', {})
    assert level is Level.WARN and "the transform 'odom' to 'base_link' is published by" in said


def test_the_frame_between_may_be_placed_by_static_transforms():
    node, publish, belief = built(frame='map', odom_frame='odom')
    node.subscriptions['/tf_static'](
        message(('odom', 'base_link', (1.0, 2.0, 0.0, 0.0, 0.0, 0.5**0.5, 0.5**0.5)))
    )
    publish(NOW, belief, NOW)
    np.testing.assert_allclose(node.sent[0][2], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ('changes', 'why'),
    [
        ({'child_frame': '/base_link'}, 'child_frame: expected a frame without a leading slash'),
        ({'frame': ''}, "frame: expected a frame without a leading slash for publish_tf, got ''"),
        ({'child_frame': 'odom'}, "child_frame: expected another than frame, got 'odom'"),
        ({'odom_frame': '/odom'}, 'odom_frame: expected a frame without a leading slash'),
        ({'odom_frame': 'odom'}, 'odom_frame: expected another than frame and child_frame, got'),
        ({'odom_frame': 'base_link'}, 'odom_frame: expected another than frame and child_fra'),
        ({'model': 'mass_spring_damper'}, 'publish_tf: expected states x, y and a heading'),
    ],
)
def test_what_tf2_would_refuse_is_refused_first(changes, why):
    given = {**GIVEN, **changes}
    if 'model' in changes:
        given = {**changes, 'publish_tf': True}
    known = settings(given)
    with pytest.raises(ValueError, match=why):
        TransformPublisher(Node(), known.scenario, known.options)


def test_without_tf2_msgs_one_line_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', None)
    known = settings(GIVEN)
    with pytest.raises(ValueError, match="the message package 'tf2_msgs' is not installed"):
        TransformPublisher(Node(), known.scenario, known.options)


def serialised(time, parent='odom', child='base_link', count=1):
    """Return the bytes of a message of transforms at a time, as on /tf."""
    return message(*[(parent, child, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))] * count, time=time)


def test_another_publisher_of_the_same_transform_is_named():
    node, publish, belief = built()
    receive = node.subscriptions['/tf']
    for step in range(20):
        time = NOW + step * SECOND // 10
        node.now = time
        publish(time, belief, time)
        receive(serialised(time))  # its own comes back
    assert publish.report(Level.OK, 'consistent', {})[0] is Level.OK and not node.said
    for step in range(3):  # the same stamps once more, as of a second estimator of the same data
        assert not node.said
        receive(serialised(NOW + step * SECOND // 10))
    wanted = "the transform 'odom' to 'base_link' is published by another node, too"
    assert node.said == [wanted]
    level, said, _ = publish.report(Level.OK, 'consistent', {})
    assert level is Level.WARN and said == wanted
    assert publish.report(Level.WARN, 'no readings', {})[1] == f'no readings; {wanted}'


@pytest.mark.parametrize(
    ('others', 'by'),
    [(['ekf'], '/ekf'), (['ekf', 'amcl'], 'one of /amcl, /ekf'), ([], 'another node')],
)
def test_nodes_that_may_publish_the_same_transform_are_named(others, by):
    node, publish, _ = built()
    node.endpoints = [SimpleNamespace(node_namespace='/', node_name=n) for n in ('us', *others)]
    for step in range(3):
        node.subscriptions['/tf'](serialised(NOW + step))
    assert publish.report(Level.OK, '', {})[1].endswith(f'is published by {by}, too')


def test_another_publisher_that_is_gone_is_forgotten(monkeypatch):
    seconds = [100.0]
    monkeypatch.setattr(transform_publisher, 'monotonic', lambda: seconds[0])
    node, publish, _ = built()
    for step in range(3):
        node.subscriptions['/tf'](serialised(NOW + step))
    assert publish.report(Level.OK, 'consistent', {})[0] is Level.WARN
    seconds[0] += 5.1
    assert publish.report(Level.OK, 'consistent', {})[0] is Level.OK
