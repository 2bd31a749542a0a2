# SPDX-License-Identifier: Apache-2.0
"""Markers of a loop in the plane or in space: ellipse, tracks, readings, bearings, sensors."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np

from kalman_ros.codecs.messages import message_type, write_stamp
from kalman_ros.codecs.paths import write_vector
from kalman_ros.core import Array
from kalman_ros.core import rotations as so3
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.body_roles import body_of
from kalman_ros.sensors.bearing import Bearing
from kalman_ros.sensors.radar import Radar

#: Standard deviations of an ellipse, as in every picture.
_SIGMAS = 2.0
#: The size of a marker as a share of the map, and the least one in m.
_SHARE, _LEAST = 0.02, 1e-3
#: What is larger is no place, and its square may be infinite.
_LARGEST = 1e12
#: The most readings of a sensor.
_READINGS = 50
#: Colours that differ without colour vision (M. Okabe and K. Ito, Color universal design, 2008).
_ESTIMATE, _TRUTH, _READING, _SENSOR = (
    (0.0, 0.45, 0.70), (0.53, 0.53, 0.53), (0.90, 0.62, 0.0), (0.80, 0.47, 0.65)
)  # fmt: skip


class MarkerDrawing:
    """What is drawn of a loop; every method takes values as the signals of the scenario have them.

    Parameters
    ----------
    scenario
        Of the estimator.
    frame
        Of the positions.
    length
        Points of a track.

    Raises
    ------
    ValueError
        If visualization_msgs is not installed, or the state has no position in the plane.
    """

    def __init__(self, scenario: Scenario, frame: str, length: int) -> None:
        self.message_type = message_type('visualization_msgs/MarkerArray')
        self._marker, self._point = (
            message_type('visualization_msgs/Marker'), message_type('geometry_msgs/Point')
        )  # fmt: skip
        space = scenario.model.state
        self._body = body_of(space, scenario.state)
        if not self._body.moves:
            names = ', '.join(space.names)
            raise ValueError(f'model: expected a state with x and y to draw, got ({names})')
        self._indices = [self._body.index[role] for role in self._body.position]
        self._names = [space.names[index] for index in self._indices]
        self._frame, self._sensors = frame, scenario.enabled
        self._time = 0
        self._state: Array | None = None
        self._truth: Array | None = None
        self._covariance: Array | None = None
        self._tracks: dict[str, deque[Any]] = {
            name: deque(maxlen=length) for name in ('estimate', 'ground truth')
        }
        self._readings: dict[str, deque[Any]] = {
            name: deque(maxlen=_READINGS) for name in self._sensors
        }
        self._bearings: dict[str, float] = {}
        self._low = self._high = np.zeros(3)
        for place in self._places():
            self._extend(place)

    def estimate(self, time: int, x: Array) -> None:
        """Take a state (n,) that was estimated, at a time in nanoseconds."""
        if _is_sound(x):
            self._time, self._state = time, x

    def covariance(self, P: Array) -> None:
        """Take a covariance (n, n)."""
        if _is_sound(P):
            self._covariance = P

    def truth(self, x: Array) -> None:
        """Take the true state (n,)."""
        if _is_sound(x):
            self._truth = x

    def reading(self, name: str, y: Array) -> None:
        """Take a reading of a sensor; only positions and bearings are drawn."""
        sensor = self._sensors[name].sensor
        if not _is_sound(y):
            return
        if isinstance(sensor, Bearing):
            self._bearings[name] = float(y[0])
        elif isinstance(sensor, Radar):
            self._add_reading(name, y[0] * np.array([np.cos(y[1]), np.sin(y[1])]))
        elif {*self._names} <= {*sensor.output.names}:
            indices = [sensor.output.names.index(coordinate) for coordinate in self._names]
            self._add_reading(name, y[indices])

    def draw(self) -> Any:
        """Return the markers, and add a point to each track; None before the first estimate."""
        if self._state is None:
            return None
        place = self._place(self._state)
        self._tracks['estimate'].append(self._point_at(place))
        self._extend(place)
        if self._truth is not None:
            self._tracks['ground truth'].append(self._point_at(self._place(self._truth)))
        size = max(_SHARE * float((self._high - self._low).max()), _LEAST)
        kind = self._marker
        markers = [self._pose('estimate', self._state, 4.0 * size, _ESTIMATE)]
        if self._truth is not None:
            markers.append(self._pose('ground truth', self._truth, 4.0 * size, _TRUTH))
        for name, color in (('estimate', _ESTIMATE), ('ground truth', _TRUTH)):
            track = self._tracks[name]
            if len(track) > 1:
                markers.append(self._new(f'track of {name}', kind.LINE_STRIP, 0.3 * size, color))
                markers[-1].points = [*track]
        if self._covariance is not None:
            markers.append(self._ellipse(place, self._covariance, size))
        for name, readings in self._readings.items():
            if readings:
                markers.append(self._new(f'readings of {name}', kind.SPHERE_LIST, size, _READING))
                markers[-1].points = [*readings]
        for name, angle in self._bearings.items():
            markers.append(self._new(f'bearing of {name}', kind.LINE_LIST, 0.3 * size, _READING))
            markers[-1].points = self._line(name, angle, place)
        places = self._places()
        if places:
            markers.append(self._new('sensors', kind.CUBE_LIST, 1.5 * size, _SENSOR))
            markers[-1].points = [self._point_at(position) for position in places]
        return self.message_type(markers=markers)

    def _place(self, x: Array) -> Array:
        """Return the position (3,) of a state."""
        return np.array([self._body.value(x, axis) for axis in 'xyz'])

    def _places(self) -> list[Array]:
        """Return the positions (3,) of the sensors that measure a bearing."""
        sensors = (source.sensor for source in self._sensors.values())
        return [np.array([*s.position, 0.0]) for s in sensors if isinstance(s, Bearing)]

    def _extend(self, place: Array) -> None:
        self._low, self._high = np.minimum(self._low, place), np.maximum(self._high, place)

    def _point_at(self, place: Sequence[float] | Array) -> Any:
        x, y, *z = map(float, place)
        return self._point(x=x, y=y, z=z[0] if z else 0.0)

    def _add_reading(self, name: str, place: Array) -> None:
        self._readings[name].append(self._point_at(place))

    def _new(self, name: str, kind: int, size: float, color: Sequence[float]) -> Any:
        """Return a marker without points."""
        marker = self._marker(ns=name, type=kind, action=self._marker.ADD)
        marker.header.frame_id = self._frame
        write_stamp(marker.header.stamp, self._time)
        marker.pose.orientation.w = 1.0
        marker.scale.x = marker.scale.y = marker.scale.z = size
        marker.color.r, marker.color.g, marker.color.b = color
        marker.color.a = 1.0
        return marker

    def _pose(self, name: str, x: Array, size: float, color: Sequence[float]) -> Any:
        """Return an arrow along the heading, or a sphere if the state has none."""
        turns = self._body.turns
        kind = self._marker.ARROW if turns else self._marker.SPHERE
        marker = self._new(name, kind, size if turns else 0.4 * size, color)
        marker.pose.position = self._point_at(self._place(x))
        if turns:
            marker.scale.y = marker.scale.z = 0.25 * size
            write_vector(marker.pose.orientation, *self._body.attitude(x).tolist())
        return marker

    def _ellipse(self, place: Array, P: Array, size: float) -> Any:
        """Return the ellipsoid of two standard deviations of the position, flat in the plane."""
        marker = self._new('ellipse', self._marker.SPHERE, 0.1 * size, _ESTIMATE)
        marker.color.a = 0.3
        marker.pose.position = self._point_at(place)
        variances, axes = np.linalg.eigh(P[np.ix_(self._indices, self._indices)])
        lengths = 2.0 * _SIGMAS * np.sqrt(np.maximum(variances, 0.0))
        if axes.shape == (2, 2):
            axes = np.block([[axes, np.zeros((2, 1))], [np.zeros((1, 2)), np.ones((1, 1))]])
            lengths = np.append(lengths, 0.1 * size)
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] *= -1.0  # or it would be a reflection
        marker.scale.x, marker.scale.y, marker.scale.z = np.maximum(lengths, _LEAST).tolist()
        write_vector(marker.pose.orientation, *so3.log(axes).tolist())
        return marker

    def _line(self, name: str, angle: float, place: Array) -> list[Any]:
        """Return the ends of a line of sight, a little longer than to the estimate."""
        sensor = self._sensors[name].sensor
        assert isinstance(sensor, Bearing)
        distance = 1.2 * float(np.hypot(*(place[:2] - sensor.position)))
        end = sensor.position + distance * np.array([np.cos(angle), np.sin(angle)])
        return [self._point_at(sensor.position), self._point_at(end)]


def _is_sound(values: Array) -> bool:
    return bool((np.abs(values) < _LARGEST).all())
