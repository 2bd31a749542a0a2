# SPDX-License-Identifier: Apache-2.0
"""Further forms of messages: reflectors, a speed of a drum, a supply, and an upward push."""

from __future__ import annotations

from ..eighth.messages import FORMS as OTHERS
from ..fourth.messages import joints
from ..messages import Form, vectors

_JOINT = 'sensor_msgs/msg/JointState'
#: The type and the bytes of each form, those of the other sets included.
FORMS: dict[str, tuple[str, Form]] = {
    **OTHERS,
    'reflectors': (_JOINT, joints(0, 'range_a', 'bearing_a', 'range_b', 'bearing_b')),
    'drum': (_JOINT, joints(1, 'drum')),
    'gauge': (_JOINT, joints(2, 'gauge')),
    'supply': (_JOINT, joints(2, 'source', 'load')),
    'twist_of_shaft': ('geometry_msgs/msg/WrenchStamped', vectors('base_link', 6, 3)),
    'push_up': ('geometry_msgs/msg/WrenchStamped', vectors('base_link', 6, 2)),
}
