# SPDX-License-Identifier: Apache-2.0
"""Messages of the thirteenth set, and what its vehicles and plants do."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from ..second.vehicles import GRAVITY
from .messages import FORMS
from .systems import SYSTEMS


def test_torques_are_efforts_in_the_order_of_the_axes() -> None:
    kind, form = FORMS['coils_and_wheel']
    assert kind == 'sensor_msgs/msg/JointState'
    assert struct.pack('<4d', 0.5, 0.25, -1.0, 2.0) in form(0, (0.5, 0.25, -1.0, 2.0))


@pytest.mark.parametrize('moved', [0.0, 0.5])
def test_ropes_are_as_long_as_they_are_from_the_start(moved: float) -> None:
    skycam = SYSTEMS['skycam']
    physics = {**skycam.physics, 'seconds': 2.0, 'x_b': 60.0 + moved}
    readings = skycam.simulate(np.random.default_rng(4), physics)
    pulleys = np.array([[0, 0, 20], [60 + moved, 0, 20], [60, 40, 23], [0, 40, 18]])
    expected = np.linalg.norm(pulleys - [28.0, 19.0, 8.0], axis=1)
    assert readings['ropes'].value[0] == pytest.approx(expected, abs=0.5)


def test_the_robot_on_the_hull_moves_as_its_wheels_turn() -> None:
    hullbot = SYSTEMS['hullbot']
    physics = {**hullbot.physics, 'seconds': 20.0, 'prism': 0.0}
    readings = hullbot.simulate(np.random.default_rng(2), physics)
    forces = readings['input'].value[:, 3:]
    assert np.linalg.norm(forces, axis=1) == pytest.approx(GRAVITY, abs=1.0)
    station, wheels = readings['station'], readings['wheels']
    way = np.linalg.norm(np.diff(station.value, axis=0), axis=1).sum()
    # the prism is above the wheels, and moves a little more as the robot turns
    assert way == pytest.approx(wheels.value[:, 0].mean() * 20.0, rel=0.1)
    assert np.ptp(readings['level'].value[:, 0]) < np.pi


def test_the_satellite_turns_slower_than_its_wheel() -> None:
    tumbler = SYSTEMS['tumbler']
    readings = tumbler.simulate(np.random.default_rng(3), {**tumbler.physics, 'seconds': 60.0})
    assert np.abs(readings['stars'].value).max() < 1.0
    assert np.abs(readings['wheel'].value).max() < 60.0


def test_lungs_breathe_out_what_they_breathe_in() -> None:
    ventilator = SYSTEMS['ventilator']
    physics = {**ventilator.physics, 'seconds': 37.0}
    readings = ventilator.simulate(np.random.default_rng(5), physics)
    assert readings['flow'].value.mean() == pytest.approx(0.0, abs=0.03)
    assert 0.1 < readings['belt'].value.min() < readings['belt'].value.max() < 1.5
