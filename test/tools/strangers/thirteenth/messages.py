# SPDX-License-Identifier: Apache-2.0
"""Further forms of messages: accelerations and rates, a bend, torques, and what cools a store."""

from __future__ import annotations

from ..fourth.messages import joints
from ..messages import Form, vectors
from ..twelfth.messages import FORMS as OTHERS

_JOINT = 'sensor_msgs/msg/JointState'
#: The type and the bytes of each form, those of the other sets included.
FORMS: dict[str, tuple[str, Form]] = {
    **OTHERS,
    'shove': ('geometry_msgs/msg/AccelStamped', vectors('base_link', 6, 0, 1)),
    'spins': ('geometry_msgs/msg/TwistStamped', vectors('base_link', 6, 3, 4, 5)),
    'bend': (_JOINT, joints(0, 'finger')),
    'coils_and_wheel': (_JOINT, joints(2, 'x', 'y', 'z', 'wheel')),
    'cooling': (_JOINT, joints(2, 'compressor', 'outside', 'door')),
}
