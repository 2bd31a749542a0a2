# SPDX-License-Identifier: Apache-2.0
"""Further forms of messages: bearings, a gate, two rotors, and what a pump and a meal bring."""

from __future__ import annotations

from ..fourth.messages import joints
from ..messages import Form
from ..tenth.messages import FORMS as OTHERS

_JOINT = 'sensor_msgs/msg/JointState'
#: The type and the bytes of each form, those of the other sets included.
FORMS: dict[str, tuple[str, Form]] = {
    **OTHERS,
    'three_bearings': (_JOINT, joints(0, 'a', 'b', 'c')),
    'gate': (_JOINT, joints(0, 'gate')),
    'rotors': (_JOINT, joints(2, 'main', 'tail')),
    'insulin_and_meal': (_JOINT, joints(1, 'insulin', 'meal')),
}
