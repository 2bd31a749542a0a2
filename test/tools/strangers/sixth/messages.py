# SPDX-License-Identifier: Apache-2.0
"""Further forms of messages: humidity, velocities in the plane, and forces in it."""

from __future__ import annotations

from ..fifth.messages import FORMS as OTHERS
from ..messages import Form, vectors

#: The type and the bytes of each form, those of the other sets included.
FORMS: dict[str, tuple[str, Form]] = {
    **OTHERS,
    'humidity': ('sensor_msgs/msg/RelativeHumidity', OTHERS['temperature'][1]),
    'planar': ('geometry_msgs/msg/TwistStamped', vectors('base_link', 6, 0, 1)),
    'push': ('geometry_msgs/msg/WrenchStamped', vectors('base_link', 6, 0, 1)),
}
