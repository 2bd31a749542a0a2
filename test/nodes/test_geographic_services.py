# SPDX-License-Identifier: Apache-2.0
"""The services of robot_localization, with its types where they are installed."""

import importlib.util
from functools import partial

import pytest

from kalman_ros.nodes.estimator.node import EstimatorNode
from kalman_ros.scenario import shipped

INSTALLED = importlib.util.find_spec('robot_localization') is not None


@pytest.mark.skipif(not INSTALLED, reason='robot_localization is not installed')
def test_the_services_have_the_names_and_types_that_nav2_calls(pair):
    from geographic_msgs.msg import GeoPoint
    from geometry_msgs.msg import Point, PoseWithCovarianceStamped
    from robot_localization.srv import (
        FromLL,
        FromLLArray,
        SetPose,
        ToggleFilterProcessing,
        ToLL,
        ToLLArray,
    )

    found = pair(EstimatorNode, file=str(shipped.file('navsat')))

    def call(kind, name, **request):
        client = found.peer.create_client(kind, name)
        found.until(client.service_is_ready, f'no service {name}')
        future = client.call_async(kind.Request(**request))
        found.until(lambda: (found.spin_peer(), future.done())[1], f'no answer of {name}')
        return future.result()

    pose = PoseWithCovarianceStamped()
    pose.pose.pose.position.x, pose.pose.pose.orientation.w = 7.0, 1.0
    call(SetPose, '/set_pose', pose=pose)
    assert found.node._online.belief.mean[0] == 7.0
    assert call(ToggleFilterProcessing, '/toggle', on=False).status
    assert not found.node._fuser.fusing
    assert call(ToggleFilterProcessing, '/toggle', on=True).status
    datum = GeoPoint(latitude=49.8728, longitude=8.6512, altitude=144.0)
    point = call(FromLL, '/fromLL', ll_point=datum).map_point
    assert (point.x, point.y, point.z) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    place = call(ToLL, '/toLL', map_point=Point(x=0.0, y=0.0, z=1.0)).ll_point
    assert place.altitude == pytest.approx(145.0, abs=1e-6)
    assert place.latitude == pytest.approx(datum.latitude, abs=1e-9)
    points = call(FromLLArray, '/fromLLArray', ll_points=[datum] * 3).map_points
    assert len(points) == 3
    places = call(ToLLArray, '/toLLArray', map_points=points).ll_points
    assert [each.altitude for each in places] == pytest.approx([144.0] * 3, abs=1e-6)


@pytest.mark.skipif(not INSTALLED, reason='geographic_msgs is not installed')
def test_places_are_asked_and_answered_as_points_of_the_earth(pair):
    from geographic_msgs.msg import GeoPointStamped
    from geometry_msgs.msg import Point, PointStamped

    found = pair(EstimatorNode, file=str(shipped.file('navsat')))
    answers = {}
    for kind, topic in ((GeoPointStamped, 'to_ll/geo_point'), (PointStamped, 'from_ll/point')):
        keep = partial(answers.__setitem__, topic)
        found.peer.create_subscription(kind, f'estimator/{topic}', keep, 10)
    ask = found.publisher(PointStamped, 'estimator/to_ll')
    ask.publish(PointStamped(point=Point(x=30.0, y=-40.0, z=2.0)))
    found.until(lambda: (found.spin_peer(), 'to_ll/geo_point' in answers)[1], 'no place')
    place = answers['to_ll/geo_point']
    assert place.position.altitude == pytest.approx(146.0, abs=1e-3)
    found.publisher(GeoPointStamped, 'estimator/from_ll/geo_point').publish(place)
    found.until(lambda: (found.spin_peer(), 'from_ll/point' in answers)[1], 'no point')
    point = answers['from_ll/point'].point
    assert (point.x, point.y) == pytest.approx((30.0, -40.0), abs=1e-6)
    assert answers['from_ll/point'].header.frame_id == 'map'
