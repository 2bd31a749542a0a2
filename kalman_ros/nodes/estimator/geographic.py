# SPDX-License-Identifier: Apache-2.0
"""Answers of an estimator with a datum: places on the Earth for local metres, and the reverse.

As topics with standard messages, and as the services of ``robot_localization`` where its types
are installed, under the names that it gives them.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module
from math import isnan, nan
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, PointStamped
from rosidl_generator_py.import_type_support_impl import UnsupportedTypeSupport
from sensor_msgs.msg import NavSatFix

from kalman_ros.codecs.messages import message_type
from kalman_ros.core.geodesy import Origin, Place, TangentPlane, place
from kalman_ros.nodes.middleware.host import Host
from kalman_ros.nodes.middleware.topics import QUESTIONS, QUEUE
from kalman_ros.pipeline.throttle import Throttle

#: Topics of the questions; each answer has that of its question and a word.
TO_LL, FROM_LL = '~/to_ll', '~/from_ll'
ANSWERS = {TO_LL: f'{TO_LL}/fix', FROM_LL: f'{FROM_LL}/point'}
#: The same places as ``geographic_msgs/GeoPointStamped``, where that package is installed.
GEO_POINTS = {TO_LL: f'{TO_LL}/geo_point', FROM_LL: f'{FROM_LL}/geo_point'}
#: The services of ``robot_localization``, by the name of their type.
SERVICES = {
    'ToLL': 'toLL', 'ToLLArray': 'toLLArray', 'FromLL': 'fromLL', 'FromLLArray': 'fromLLArray',
}  # fmt: skip
#: Answer of a service, which cannot fail, without a result.
_NOWHERE = (nan, nan, nan)


def local_of(plane: TangentPlane, where: Place) -> tuple[float, ...]:
    """Return metres east, north and up; a place without a height is at that of the datum."""
    if isnan(where.altitude):
        where = where._replace(altitude=plane.datum.altitude)
    return tuple(plane.local(where).tolist())


def place_at(plane: TangentPlane, point: Any) -> Place:
    """Return the place at a ``geometry_msgs/Point``; ValueError if it is not finite."""
    local = np.array([point.x, point.y, point.z])
    if not np.isfinite(local).all():
        raise ValueError('expected finite numbers')
    return place('point', plane.place(local))


class GeographicServer:
    """Converts between the frame of the estimate and the Earth.

    Parameters
    ----------
    node
        The estimator's node, which is being activated.
    frame
        Frame of the estimates; a point in another one is refused, one without a frame is not.
    origin
        Datum, which the first fix may set.
    level
        Whether the map is a plane: a place has no height in it.
    """

    def __init__(self, node: Host, frame: str, origin: Origin, *, level: bool = False) -> None:
        self._frame, self._origin, self._level = frame, origin, level
        self._warn = Throttle(node.get_logger().warning)
        node.create_subscription(PointStamped, TO_LL, self._on_point, QUESTIONS)
        node.create_subscription(NavSatFix, FROM_LL, self._on_fix, QUESTIONS)
        self._fixes = node.create_publisher(NavSatFix, ANSWERS[TO_LL], QUEUE)
        self._points = node.create_publisher(PointStamped, ANSWERS[FROM_LL], QUEUE)
        self._geo_points = None
        with suppress(ValueError):  # the package is not installed
            kind = message_type('geographic_msgs/GeoPointStamped')
            node.create_subscription(kind, GEO_POINTS[FROM_LL], self._on_geo_point, QUESTIONS)
            self._geo_points = node.create_publisher(kind, GEO_POINTS[TO_LL], QUEUE)
        types = {kind: service_type(kind) for kind in SERVICES}
        if None in types.values():
            node.get_logger().info(
                f'no services {", ".join(SERVICES.values())}: robot_localization, which has '
                f'their types, is not installed; topics: {TO_LL}, {FROM_LL}'
            )
            return
        self._make_place = message_type('geographic_msgs/GeoPoint')
        answers = {
            'ToLL': self._to_ll,
            'ToLLArray': self._to_ll_array,
            'FromLL': self._from_ll,
            'FromLLArray': self._from_ll_array,
        }
        for kind, answer in answers.items():
            node.create_service(types[kind], SERVICES[kind], answer)

    def _on_point(self, message: PointStamped) -> None:
        given = message.header.frame_id.lstrip('/')
        if given not in ('', self._frame):
            self._warn(f"{TO_LL}: expected frame '{self._frame}', got '{given}'")
            return
        where = self._answer(TO_LL, lambda plane: place_at(plane, message.point))
        if where is not None:
            fix = NavSatFix(header=message.header)
            fix.status.status = fix.status.STATUS_FIX
            fix.latitude, fix.longitude, fix.altitude = where
            self._fixes.publish(fix)
            if self._geo_points is not None:
                geo_point = self._geo_points.msg_type(header=message.header)
                position = geo_point.position
                position.latitude, position.longitude, position.altitude = where
                self._geo_points.publish(geo_point)

    def _on_fix(self, message: NavSatFix) -> None:
        # what asks for a place has no status of a receiver
        self._answer_place(message.header, message)

    def _on_geo_point(self, message: Any) -> None:
        self._answer_place(message.header, message.position)

    def _answer_place(self, header: Any, asked: Any) -> None:
        """Publish the local metres of a latitude, longitude and altitude."""
        where = asked.latitude, asked.longitude, asked.altitude
        local = self._answer(FROM_LL, lambda plane: local_of(plane, _place(where)))
        if local is not None:
            point = PointStamped(header=header, point=self._point(local))
            point.header.frame_id = self._frame
            self._points.publish(point)

    def _to_ll(self, request: Any, response: Any) -> Any:
        self._write_place('toLL', request.map_point, response.ll_point)
        return response

    def _to_ll_array(self, request: Any, response: Any) -> Any:
        response.ll_points = [self._make_place() for _ in request.map_points]
        for point, geo_point in zip(request.map_points, response.ll_points):
            self._write_place('toLLArray', point, geo_point)
        return response

    def _from_ll(self, request: Any, response: Any) -> Any:
        response.map_point = self._read_place('fromLL', request.ll_point)
        return response

    def _from_ll_array(self, request: Any, response: Any) -> Any:
        read = partial(self._read_place, 'fromLLArray')
        response.map_points = [read(geo_point) for geo_point in request.ll_points]
        return response

    def _write_place(self, service: str, point: Any, result: Any) -> None:
        where = self._answer(service, lambda plane: place_at(plane, point))
        result.latitude, result.longitude, result.altitude = where or _NOWHERE

    def _read_place(self, service: str, geo_point: Any) -> Point:
        where = geo_point.latitude, geo_point.longitude, geo_point.altitude
        local = self._answer(service, lambda plane: local_of(plane, _place(where)))
        return self._point(local or _NOWHERE)

    def _point(self, local: tuple[float, ...]) -> Point:
        x, y, z = local
        return Point(x=x, y=y, z=0.0 if self._level and not isnan(x) else z)

    def _answer(self, question: str, convert: Callable[[TangentPlane], Any]) -> Any:
        """Return what ``convert`` makes of the plane; None with a warning if that is nothing."""
        plane = self._origin.plane
        if plane is None:
            self._warn(f'{question}: there is no datum before the first fix')
            return None
        try:
            return convert(plane)
        except ValueError as error:
            self._warn(f'{question}: {error}')
        return None


def _place(values: tuple[float, float, float]) -> Place:
    """Return the place of latitude, longitude and altitude, which may be NaN; or ValueError."""
    latitude, longitude, height = values
    known = place('place', (latitude, longitude, 0.0 if isnan(height) else height))
    return known._replace(altitude=height)


def service_type(kind: str) -> Any:
    """Return a type of ``robot_localization``'s services; None if it cannot be used."""
    try:
        return getattr(import_module('robot_localization.srv'), kind)
    except (ImportError, AttributeError, UnsupportedTypeSupport):
        return None
