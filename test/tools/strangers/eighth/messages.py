# SPDX-License-Identifier: Apache-2.0
"""Further forms of messages: three wheels, a position along a shaft's axis, gates, and flaps."""

from __future__ import annotations

from ..fourth.messages import joints
from ..messages import Form
from ..seventh.messages import FORMS as OTHERS

_JOINT = 'sensor_msgs/msg/JointState'
#: The type and the bytes of each form, those of the other sets included.
FORMS: dict[str, tuple[str, Form]] = {
    **OTHERS,
    'three_wheels': (_JOINT, joints(1, 'a', 'b', 'c')),
    'slide': (_JOINT, joints(0, 'slide')),
    'gates': (_JOINT, joints(1, 'inflow', 'offtake')),
    'jacket_and_feed': (_JOINT, joints(0, 'jacket', 'feed')),
    'flaps': (_JOINT, joints(0, 'fore', 'aft')),
}
