# SPDX-License-Identifier: Apache-2.0
"""Further forms of messages: markers in space, forces on rolls, and a speed with a heading."""

from __future__ import annotations

from ..fourth.messages import joints
from ..messages import Form, vectors
from ..ninth.messages import FORMS as OTHERS

_JOINT = 'sensor_msgs/msg/JointState'
_TWIST = 'geometry_msgs/msg/TwistStamped'
_MARKERS = tuple(f'{kind}_{k}' for k in 'abc' for kind in ('range', 'bearing', 'elevation'))
#: The type and the bytes of each form, those of the other sets included.
FORMS: dict[str, tuple[str, Form]] = {
    **OTHERS,
    'markers': (_JOINT, joints(0, *_MARKERS)),
    'unwinder': (_JOINT, joints(1, 'unwinder')),
    'rewinder': (_JOINT, joints(1, 'rewinder')),
    'rolls': (_JOINT, joints(2, 'brake', 'drive')),
    'feed_and_stirrer': (_JOINT, joints(1, 'feed', 'stirrer')),
    'speed_and_heading': (_TWIST, vectors('base_link', 6, 0, 5)),
}
