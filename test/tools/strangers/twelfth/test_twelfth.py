# SPDX-License-Identifier: Apache-2.0
"""Messages of the twelfth set, and what its vehicles and plants do."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from ..second.vehicles import GRAVITY
from .messages import FORMS
from .systems import SYSTEMS


def test_two_levels_are_positions_in_the_order_of_the_tanks() -> None:
    kind, form = FORMS['two_levels']
    assert kind == 'sensor_msgs/msg/JointState'
    assert struct.pack('<2d', 1.75, 1.25) in form(0, (1.75, 1.25))


@pytest.mark.parametrize('moved', [0.0, 0.5])
def test_loudspeakers_are_as_far_as_they_are_from_the_start(moved: float) -> None:
    docent = SYSTEMS['docent']
    physics = {**docent.physics, 'seconds': 2.0, 'x_c': -2.0 + moved}
    readings = docent.simulate(np.random.default_rng(4), physics)
    place = np.array([[7.0, 3.0], [-5.0, 6.5], [-2.0 + moved, -7.0]])
    expected = np.linalg.norm(place - [1.0, -0.5], axis=1)
    assert readings['sound'].value[0] == pytest.approx(expected, abs=0.4)


def test_both_antennas_of_the_sprayer_are_as_far_apart_as_its_file_says() -> None:
    sprayer = SYSTEMS['sprayer']
    readings = sprayer.simulate(np.random.default_rng(2), {**sprayer.physics, 'seconds': 4.0})
    fore, aft = readings['fore'], readings['aft']
    inside = (aft.time > fore.time[0]) & (aft.time < fore.time[-1])
    between = [np.interp(aft.time[inside], fore.time, fore.value[:, k]) for k in range(3)]
    apart = np.linalg.norm(np.stack(between, axis=1) - aft.value[inside], axis=1)
    # the chord of a curve over a fifth of a second
    assert apart == pytest.approx(1.8, abs=0.05)


def test_the_submarine_stays_under_water_and_reads_its_depth() -> None:
    minisub = SYSTEMS['minisub']
    readings = minisub.simulate(np.random.default_rng(3), {**minisub.physics, 'seconds': 60.0})
    depth = (readings['gauge'].value[:, 0] - 101325.0) / (1000.0 * GRAVITY)
    assert 3.0 < depth.min() < depth.max() < 13.0


def test_the_store_is_warmer_above() -> None:
    solar = SYSTEMS['solar']
    readings = solar.simulate(np.random.default_rng(5), {**solar.physics, 'seconds': 3600.0})
    top, bottom = readings['top'], readings['bottom']
    assert top.value.mean() > bottom.value.mean() + 1.0
