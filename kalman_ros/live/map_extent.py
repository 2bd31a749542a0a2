# SPDX-License-Identifier: Apache-2.0
"""Scenarios that can be drawn on a map, and the extent of the map."""

from __future__ import annotations

import numpy as np

from kalman_ros.codecs.messages import message_type
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.body_roles import body_of
from kalman_ros.sensors.bearing import Bearing

#: Ratio of the extent to the largest distance, and the least extent in m.
_ROOM, _LEAST = 1.5, 1.0


def is_drawn(scenario: Scenario) -> bool:
    """Return whether the node ``markers`` can draw a scenario on this machine."""
    try:
        message_type('visualization_msgs/MarkerArray')
    except ValueError:
        return False
    return body_of(scenario.model.state, scenario.state).moves


def extent(scenario: Scenario) -> float:
    """Return the side of a square about the origin, in m, with the initial state and sensors."""
    body = body_of(scenario.model.state, scenario.state)
    belief = scenario.initial_belief
    indices = [body.index['x'], body.index['y']]
    deviations = np.sqrt(belief.covariance.diagonal())[indices]
    distances = [
        np.abs(scenario.initial_state[indices]).max(),
        (np.abs(belief.mean[indices]) + 2.0 * deviations).max(),
    ]
    for source in scenario.sensors.values():
        if isinstance(source.sensor, Bearing):
            distances.append(np.abs(source.sensor.position).max())
    finite = [float(distance) for distance in distances if np.isfinite(distance)]
    return max(2.0 * _ROOM * max(finite, default=0.0), _LEAST)
