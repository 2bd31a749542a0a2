# SPDX-License-Identifier: Apache-2.0
"""Transforms from bytes, without tf2_msgs; hostile bytes are none."""

import struct

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import TransformStamped
from rclpy.serialization import serialize_message
from static_frames import message

from kalman_ros.codecs.messages import UndecodableError
from kalman_ros.codecs.transform_list import transforms_in


@pytest.mark.parametrize('names', [('a', 'b'), ('base_link', 'imu'), ('x' * 5, '/y' * 9)])
def test_transforms_are_those_of_the_message(names):
    numbers = [0.1, -0.2, 0.3, 0.0, 0.6, 0.0, 0.8]
    data = message(*[(*names, numbers), ('odd', 'names_', numbers[::-1])], time=3_000_000_007)
    first, second = transforms_in(data)
    assert first[:3] == (3_000_000_007, names[0], names[1].lstrip('/'))
    assert first[3:] == (tuple(numbers[:3]), tuple(numbers[3:]))
    assert second[3:] == (tuple(numbers[::-1][:3]), tuple(numbers[::-1][3:]))


def test_the_bytes_are_those_of_the_middleware():
    # one transform, and the same of the middleware, 4 bytes of a count earlier; whatever is in the
    # bytes between them that align the second name
    one = TransformStamped()
    one.header.frame_id, one.child_frame_id = 'odom', 'base'
    one.transform.rotation.w = 0.5
    numbers = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5]
    whole, ours = bytes(serialize_message(one)), message(('odom', 'base', numbers))
    assert whole[4:21] == ours[8:25] and whole[24:33] == ours[28:37]
    assert struct.pack('<4d', *numbers[3:]) in whole and struct.pack('<4d', *numbers[3:]) in ours


def test_what_is_no_message_of_transforms_is_undecodable():
    data, rng = message(('a', 'b', np.zeros(7))), np.random.default_rng(1)
    for cut in range(len(data)):
        with pytest.raises(UndecodableError):
            transforms_in(data[:cut])
    for _ in range(200):
        try:
            transforms_in(rng.bytes(rng.integers(0, 200)))
        except UndecodableError:
            continue
