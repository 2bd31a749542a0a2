# SPDX-License-Identifier: Apache-2.0
"""The bytes of a ``tf2_msgs/TFMessage``, which takes no package."""

import struct


def message(*transforms, time=0):
    """Return the bytes of transforms, each (parent, child, (x, y, z, qx, qy, qz, qw)).

    The stamps are all at ``time``, in nanoseconds.
    """
    data = bytearray(struct.pack('<I', len(transforms)))

    def align(size):
        data.extend(bytes(-len(data) % size))

    for parent, child, numbers in transforms:
        align(4)
        data.extend(struct.pack('<iI', *divmod(time, 1_000_000_000)))
        for name in (parent, child):
            align(4)
            text = name.encode() + b'\0'
            data.extend(struct.pack('<I', len(text)) + text)
        align(8)
        data.extend(struct.pack('<7d', *numbers))
    return b'\0\1\0\0' + bytes(data)
