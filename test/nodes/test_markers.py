# SPDX-License-Identifier: Apache-2.0
"""Markers: what is drawn is where it is, and nothing is done without a subscriber."""

from functools import cache

import numpy as np
import pytest

pytest.importorskip('rclpy')
pytest.importorskip('visualization_msgs')

from nav_msgs.msg import Odometry
from std_msgs.msg import Float64MultiArray
from visualization_msgs.msg import Marker, MarkerArray

from kalman_ros.core import rotations as so3
from kalman_ros.live.map_extent import is_drawn
from kalman_ros.nodes.markers.drawing import MarkerDrawing
from kalman_ros.nodes.markers.node import MarkersNode
from kalman_ros.scenario import build, shipped
from kalman_ros.scenario.parameter_files import from_file


@cache
def scenario(name):
    return build(from_file(shipped.file(name), 'estimator'))


DRAWN = [name for name in shipped.names() if is_drawn(scenario(name))]


def drawing(name, length=5):
    return MarkerDrawing(scenario(name), 'map', length)


def by_name(message):
    found = {}
    for marker in message.markers:
        found.setdefault(marker.ns, []).append(marker)
    assert all(len(markers) == 1 for markers in found.values() if markers[0].ns != 'estimate')
    return {name: markers[0] for name, markers in found.items()}


def matrix(q):
    return so3.exp(so3.from_quaternion(np.array([q.x, q.y, q.z, q.w])))


def points(marker):
    return [(point.x, point.y, point.z) for point in marker.points]


def test_the_scenarios_in_the_plane_are_drawn():
    assert {'two_bearings', 'robot_2d', 'robot_3d', 'mass_spring_damper_2d'} <= {*DRAWN}
    assert not {'cart_pole', 'nile', 'dc_motor'} & {*DRAWN}
    with pytest.raises(ValueError, match=r'expected a state with x and y to draw, got \(level\)'):
        drawing('nile')


@pytest.mark.parametrize('name', DRAWN)
def test_the_ellipsoid_is_that_of_the_covariance(name):
    of = scenario(name)
    n, found = of.model.state.size, drawing(name)
    root = np.random.default_rng(1).normal(size=(n, n))
    P = root @ root.T
    x = of.initial_state
    assert found.draw() is None
    found.estimate(1_500_000_000, x)
    found.covariance(P)
    marker = by_name(found.draw())['ellipse']
    assert (marker.type, marker.header.frame_id) == (Marker.SPHERE, 'map')
    assert (marker.header.stamp.sec, marker.header.stamp.nanosec) == (1, 500_000_000)
    axes = [axis for axis in 'xyz' if axis in of.model.state.names]
    indices = [of.model.state.names.index(axis) for axis in axes]
    R, k = matrix(marker.pose.orientation), len(axes)
    halves = np.array([marker.scale.x, marker.scale.y, marker.scale.z])[:k] / 2.0
    if k == 2:
        assert R[2] == pytest.approx([0.0, 0.0, 1.0])
    shown = R[:k, :k] @ np.diag((halves / 2.0) ** 2) @ R[:k, :k].T
    assert shown == pytest.approx(P[np.ix_(indices, indices)])
    place = [getattr(marker.pose.position, axis) for axis in axes]
    assert place == pytest.approx(x[indices])


def test_a_line_of_sight_starts_at_its_sensor_and_has_the_angle_that_was_read():
    found = drawing('two_bearings')
    found.estimate(0, np.array([0.0, 30.0, 0.0, 0.0]))
    found.reading('east', np.array([2.0]))
    found.reading('west', np.array([np.nan]))
    markers = by_name(found.draw())
    assert 'bearing of west' not in markers
    start, end = np.array(points(markers['bearing of east']))
    assert start == pytest.approx([20.0, 5.0, 0.0])
    assert np.arctan2(*(end - start)[1::-1]) == pytest.approx(2.0)
    assert np.linalg.norm(end - start) > np.hypot(20.0, 25.0)
    assert {*points(markers['sensors'])} == {(-20.0, 0.0, 0.0), (20.0, 5.0, 0.0)}


def test_a_radar_and_a_position_are_points():
    found = drawing('lidar_radar')
    found.estimate(0, np.zeros(5))
    found.reading('radar', np.array([2.0, np.pi / 2, 7.0]))
    found.reading('lidar', np.array([3.0, 4.0]))
    markers = by_name(found.draw())
    assert np.array(points(markers['readings of radar'])) == pytest.approx(
        np.array([[0.0, 2.0, 0.0]]), abs=1e-12
    )
    assert points(markers['readings of lidar']) == [(3.0, 4.0, 0.0)]


def test_readings_of_something_else_and_what_is_not_finite_are_not_drawn():
    found = drawing('robot_2d')
    x = np.zeros(8)
    found.estimate(0, x)
    before = len(found.draw().markers)
    found.reading('imu', np.zeros(3))
    found.covariance(np.full((8, 8), np.nan))
    found.truth(np.full(8, np.inf))
    found.estimate(1, np.full(8, np.nan))
    markers = by_name(found.draw())
    assert len(markers) <= before + 1  # the track has a second point
    assert markers['estimate'].header.stamp.nanosec == 0


@pytest.mark.parametrize('value', [np.nan, np.inf, -1e308, 1e155])
def test_hostile_numbers_leave_the_drawing_as_it_was(value):
    found = drawing('robot_3d')
    found.estimate(1, np.zeros(15))
    found.covariance(np.eye(15))
    found.draw()
    expected = found.draw()
    found.covariance(np.full((15, 15), value))
    found.truth(np.full(15, value))
    found.estimate(2, np.full(15, value))
    found.reading('position', np.full(3, value))
    names = [marker.ns for marker in found.draw().markers]
    assert names == [marker.ns for marker in expected.markers]


def test_a_track_ends():
    found = drawing('robot_2d', length=3)
    for step in range(10):
        found.estimate(step, np.array([float(step), *7 * [0.0]]))
        markers = by_name(found.draw())
    assert points(markers['track of estimate']) == [(x, 0.0, 0.0) for x in (7.0, 8.0, 9.0)]


def test_an_arrow_has_the_heading():
    found = drawing('robot_2d')
    x = np.zeros(8)
    x[2] = 0.7
    found.estimate(0, x)
    marker = by_name(found.draw())['estimate']
    assert marker.type == Marker.ARROW
    assert matrix(marker.pose.orientation)[:, 0] == pytest.approx([np.cos(0.7), np.sin(0.7), 0.0])


@pytest.mark.slow
def test_the_node_subscribes_only_while_somebody_looks(pair):
    found = pair(MarkersNode)
    peer, received = found.peer, []
    publisher = peer.create_publisher(Odometry, 'estimate', 10)
    whole = peer.create_publisher(Float64MultiArray, 'estimate/covariance', 10)
    assert not found.node.watched
    looking = peer.create_subscription(MarkerArray, 'markers', received.append, 10)
    found.until(lambda: publisher.get_subscription_count() > 0, 'it does not subscribe')
    found.until(lambda: whole.get_subscription_count() > 0, 'it does not subscribe')
    message = Odometry()
    message.pose.pose.position.x = 3.0
    message.header.stamp.sec = 1
    publisher.publish(message)
    whole.publish(Float64MultiArray(data=[1.0]))  # of a wrong size

    def take():
        taken = peer_take(looking)
        received.extend(taken)
        return any('estimate' in by_name(each) for each in taken)

    found.until(take, 'nothing is drawn')
    assert by_name(received[-1])['estimate'].pose.position.x == 3.0
    peer.destroy_subscription(looking)
    found.until(lambda: publisher.get_subscription_count() == 0, 'it stays subscribed')


@pytest.mark.slow
def test_a_node_draws_at_its_rate_a_track_of_its_length(pair):
    node = pair(MarkersNode, marker_rate=4.0, track_length=3).node
    assert [timer.timer_period_ns for timer in node.timers].count(250_000_000) == 1
    found = node._drawing
    for step in range(10):
        found.estimate(step, np.full(4, float(step)))
        markers = by_name(found.draw())
    assert len(points(markers['track of estimate'])) == 3


def peer_take(subscription):
    found = []
    while (taken := subscription.handle.take_message(subscription.msg_type, False)) is not None:
        found.append(taken[0])
    return found


@pytest.mark.parametrize('name', ['two_bearings', 'mass_spring_damper_2d'])
def test_a_sphere_is_thicker_than_its_track_and_smaller_than_an_arrow_is_long(name):
    """In a drawing of a robot with a heading, the arrow is as long by the same measure."""
    sizes = []
    for each in (name, 'robot_2d'):
        found = drawing(each)
        for time in range(2):
            found.estimate(time, np.zeros(scenario(each).model.state.size))
            markers = by_name(found.draw())
        marker, track = markers['estimate'], markers['track of estimate']
        sizes.append(marker.scale.x / track.scale.x)
    assert 1.0 < sizes[0] < sizes[1]


def test_a_sphere_is_round():
    found = drawing('two_bearings')
    found.estimate(0, np.zeros(4))
    marker = by_name(found.draw())['estimate']
    assert marker.type == Marker.SPHERE
    assert marker.scale.x == marker.scale.y == marker.scale.z
