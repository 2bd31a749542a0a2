# SPDX-License-Identifier: Apache-2.0
"""Further forms of messages: ranges, levels of tanks, sun and pump, and what a machine takes."""

from __future__ import annotations

from ..eleventh.messages import FORMS as OTHERS
from ..fourth.messages import joints
from ..messages import Form

_JOINT = 'sensor_msgs/msg/JointState'
#: The type and the bytes of each form, those of the other sets included.
FORMS: dict[str, tuple[str, Form]] = {
    **OTHERS,
    'three_ranges': (_JOINT, joints(0, 'a', 'b', 'c')),
    'two_ranges': (_JOINT, joints(0, 'a', 'b')),
    'float': (_JOINT, joints(0, 'float')),
    'two_levels': (_JOINT, joints(0, 'third', 'fourth')),
    'two_pumps': (_JOINT, joints(1, 'first', 'second')),
    'sun_and_pump': (_JOINT, joints(2, 'sun', 'pump', 'outside')),
    'clearance_and_loss': (_JOINT, joints(1, 'clearance', 'loss')),
}
