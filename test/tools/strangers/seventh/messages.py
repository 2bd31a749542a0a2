# SPDX-License-Identifier: Apache-2.0
"""Further forms of messages: two joints, probes and pumps, and commands of two forces."""

from __future__ import annotations

from ..fourth.messages import joints
from ..messages import Form, vectors
from ..sixth.messages import FORMS as OTHERS

_JOINT = 'sensor_msgs/msg/JointState'
_WRENCH = 'geometry_msgs/msg/WrenchStamped'
#: The type and the bytes of each form, those of the other sets included.
FORMS: dict[str, tuple[str, Form]] = {
    **OTHERS,
    'mount': (_JOINT, joints(0, 'azimuth', 'altitude')),
    'mount_torques': (_JOINT, joints(2, 'azimuth', 'altitude')),
    'probes': (_JOINT, joints(0, 'air', 'soil')),
    'climate': (_JOINT, joints(2, 'heat', 'outside', 'sun')),
    'pumps': (_JOINT, joints(1, 'brine', 'water')),
    'helm': (_WRENCH, vectors('base_link', 6, 0, 1, 5)),
}
