# SPDX-License-Identifier: Apache-2.0
"""Places on the Earth for local metres, and the reverse, as topics and as answers of services."""

from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Point, PointStamped
from sensor_msgs.msg import NavSatFix

from kalman_ros.codecs.messages import decode, write_stamp
from kalman_ros.core.geodesy import Origin, Place, TangentPlane
from kalman_ros.nodes.estimator.geographic import GeographicServer
from kalman_ros.nodes.estimator.node import EstimatorNode
from kalman_ros.scenario import shipped

DATUM = Place(49.8728, 8.6512, 144.0)
PLANE = TangentPlane(DATUM)


def received(found, kind, topic):
    subscription = found.peer.create_subscription(kind, topic, print, 10, raw=True)
    messages = []

    def take():
        while (taken := subscription.handle.take_message(kind, True)) is not None:
            messages.append(decode(taken[0], kind))
        return messages

    return take


def test_points_and_places_are_answered_on_topics(pair, capfd):
    found = pair(EstimatorNode, file=str(shipped.file('navsat')))
    said = capfd.readouterr().err
    assert 'no services toLL, toLLArray, fromLL, fromLLArray: robot_localization' in said
    fixes = received(found, NavSatFix, 'estimator/to_ll/fix')
    points = received(found, PointStamped, 'estimator/from_ll/point')
    ask = found.publisher(PointStamped, 'estimator/to_ll')
    point = PointStamped(point=Point(x=30.0, y=-40.0, z=2.0))
    write_stamp(point.header.stamp, 123_000_000_456)
    point.header.frame_id = '/map'
    ask.publish(point)
    found.until(fixes, 'no place')
    (fix,) = fixes()
    where = fix.latitude, fix.longitude, fix.altitude
    assert where == pytest.approx(PLANE.place(np.array([30.0, -40.0, 2.0])), abs=1e-12)
    assert fix.header.stamp == point.header.stamp
    found.publisher(NavSatFix, 'estimator/from_ll').publish(fix)
    found.until(points, 'no point')
    (back,) = points()
    assert (back.point.x, back.point.y, back.point.z) == pytest.approx((30, -40, 0), abs=1e-6)
    assert back.header.frame_id == 'map' and back.header.stamp == point.header.stamp
    point.header.frame_id = 'odom'
    ask.publish(point)
    found.until(
        lambda: "to_ll: expected frame 'map', got 'odom'" in capfd.readouterr().err, 'no warning'
    )


class Node:
    """What the server uses of a node."""

    def __init__(self):
        self.said = []

    def create_subscription(self, *_):
        pass

    def create_publisher(self, *_):
        return SimpleNamespace(publish=self.said.append)

    def get_logger(self):
        return SimpleNamespace(warning=self.said.append, info=lambda text: None)


def served(datum=DATUM, **options):
    node = Node()
    server = GeographicServer(node, 'map', Origin(datum), **options)
    server._make_place = SimpleNamespace
    return node, server


def geographic(latitude, longitude, altitude=0.0):
    return SimpleNamespace(latitude=latitude, longitude=longitude, altitude=altitude)


def test_services_answer_one_and_many():
    _, server = served()
    where = PLANE.place(np.array([100.0, 20.0, -3.0]))
    response = server._from_ll(SimpleNamespace(ll_point=geographic(*where)), SimpleNamespace())
    found = response.map_point
    assert (found.x, found.y, found.z) == pytest.approx((100, 20, -3), abs=1e-6)
    request = SimpleNamespace(ll_points=[geographic(*where), geographic(*DATUM)])
    many = server._from_ll_array(request, SimpleNamespace()).map_points
    assert [each.x for each in many] == pytest.approx([100.0, 0.0], abs=1e-6)
    response = SimpleNamespace(ll_point=SimpleNamespace())
    place = server._to_ll(SimpleNamespace(map_point=found), response).ll_point
    assert (place.latitude, place.longitude, place.altitude) == pytest.approx(where, abs=1e-9)
    places = server._to_ll_array(SimpleNamespace(map_points=many), SimpleNamespace()).ll_points
    assert places[1].altitude == pytest.approx(DATUM.altitude, abs=1e-6)


def test_a_place_without_a_height_is_at_that_of_the_datum():
    _, server = served()
    request = SimpleNamespace(ll_point=geographic(49.8728, 8.6512, float('nan')))
    point = server._from_ll(request, SimpleNamespace()).map_point
    assert (point.x, point.y, point.z) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_a_place_of_a_plane_has_no_height():
    node, server = served(level=True)
    where = PLANE.place(np.array([100.0, 20.0, -3.0]))
    found = server._from_ll(SimpleNamespace(ll_point=geographic(*where)), SimpleNamespace())
    assert (found.map_point.x, found.map_point.z) == (pytest.approx(100.0, abs=1e-6), 0.0)
    server._on_fix(NavSatFix(latitude=where[0], longitude=where[1], altitude=where[2]))
    assert node.said[-1].point.z == 0.0
    nowhere = server._from_ll(SimpleNamespace(ll_point=geographic(91.0, 0.0)), SimpleNamespace())
    assert np.isnan(nowhere.map_point.z)


@pytest.mark.parametrize(
    ('datum', 'place', 'why'),
    [
        (DATUM, (91.0, 0.0), 'place: expected a latitude of -90 to 90'),
        (DATUM, (float('nan'), 0.0), 'place: expected a latitude of -90 to 90'),
        (DATUM, (0.0, 0.0, float('inf')), 'place: expected an altitude in m'),
        (None, (49.0, 8.0), 'there is no datum before the first fix'),
    ],
)
def test_what_has_no_answer_is_nan_with_one_warning(datum, place, why):
    node, server = served(datum)
    for _ in range(100):
        request = SimpleNamespace(ll_point=geographic(*place))
        found = server._from_ll(request, SimpleNamespace()).map_point
        assert np.isnan([found.x, found.y, found.z]).all()
    assert len(node.said) == 1 and why in node.said[0]


@pytest.mark.parametrize('point', [(np.nan, 0.0, 0.0), (0.0, np.inf, 0.0), (1e30, 0.0, 0.0)])
def test_a_point_that_is_nowhere_has_no_place(point):
    node, server = served()
    message = PointStamped(point=Point(**dict(zip('xyz', map(float, point)))))
    server._on_point(message)
    assert len(node.said) == 1 and isinstance(node.said[0], str)


def test_a_question_about_a_place_has_no_status():
    node, server = served()
    for status in (-2, -1, 0):
        fix = NavSatFix(latitude=DATUM.latitude, longitude=DATUM.longitude, altitude=144.0)
        fix.status.status = status
        server._on_fix(fix)
        assert node.said[-1].point.x == pytest.approx(0.0, abs=1e-6)
    server._on_fix(NavSatFix(latitude=91.0))
    assert node.said[-1] == '~/from_ll: place: expected a latitude of -90 to 90 degrees, got 91'
