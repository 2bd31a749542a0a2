# SPDX-License-Identifier: Apache-2.0
"""Which scenarios can be drawn on a map, and how large the map should be."""

from __future__ import annotations

import numpy as np

from kalman_ros.codecs.messages import message_type
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.body_roles import body_of
from kalman_ros.sensors.bearing import Bearing

#: The room around what is drawn, as a factor, and the least extent in m.
_ROOM, _LEAST = 1.5, 1.0


def is_drawn(scenario: Scenario) -> bool:
    """Return whether the node ``markers`` can draw a scenario here."""
    try:
        message_type('visualization_msgs/MarkerArray')
    except ValueError:
        return False
    return body_of(scenario.model.state, scenario.state).moves


def extent(scenario: Scenario) -> float:
    """Return the side, in m, of a square about the origin with states and sensors at the start."""
    body = body_of(scenario.model.state, scenario.state)
    belief = scenario.initial_belief
    indices = [body.index['x'], body.index['y']]
    deviations = np.sqrt(belief.covariance.diagonal())[indices]
    far = [
        np.abs(scenario.initial_state[indices]).max(),
        (np.abs(belief.mean[indices]) + 2.0 * deviations).max(),
    ]
    for source in scenario.sensors.values():
        if isinstance(source.sensor, Bearing):
            far.append(np.abs(source.sensor.position).max())
    finite = [float(each) for each in far if np.isfinite(each)]
    return max(2.0 * _ROOM * max(finite, default=0.0), _LEAST)
