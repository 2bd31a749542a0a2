# SPDX-License-Identifier: Apache-2.0
"""Messages of the fourth set."""

import math
import struct

import pytest

from .messages import FORMS


@pytest.mark.parametrize('angles', [(0.3, 0, 0), (0, -0.4, 0), (0.2, -0.5, 2.0)])
def test_an_attitude_is_the_product_of_its_turns(angles: tuple[float, float, float]) -> None:
    body = FORMS['attitude'][1](0, angles)
    x, y, z, w = struct.unpack_from('<4d', body, body.index(b'base_link\0') - 4 + 16)
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x**2 + y**2))
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y**2 + z**2))
    assert (roll, math.asin(2.0 * (w * y - z * x)), yaw) == pytest.approx(angles)
