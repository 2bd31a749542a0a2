# SPDX-License-Identifier: Apache-2.0
"""The systems of the eleventh set; those of MuJoCo are only here where it can be imported.

``seconds`` is the length of a recording of each; the other parameters are those of its simulator.
"""

from __future__ import annotations

from pathlib import Path

from ..systems import System
from ..third.bodies import AVAILABLE
from . import bodies, plants, vehicles

_ROBOTS = Path(__file__).with_name('robots')
_OWN = (
    System(
        vehicles.vacuum, {'seconds': 90.0, 'y_a': 1.0, 'carpet': 1.0, 'halt': 1e6}, _ROBOTS
    ),
    System(vehicles.picker, {'seconds': 60.0, 'ahead': 0.0, 'lag': 0.3}, _ROBOTS),
    System(vehicles.skidder, {'seconds': 60.0, 'antenna': -0.6}, _ROBOTS),
    System(vehicles.backpack, {'seconds': 60.0, 'x_d': 7.0}, _ROBOTS),
    System(vehicles.barge, {'seconds': 240.0, 'bow': 18.0}, _ROBOTS),
    System(
        plants.voicecoil,
        {'seconds': 50.0, 'mass': 0.4, 'magnet': 8.0, 'ohms': 4.0, 'least': 0.0, 'halt': 1e6},
        _ROBOTS,
    ),
    System(
        plants.glucose,
        {'seconds': 28800.0, 'sensitivity': 1.5e-5, 'skin': 400.0, 'pump': 1.0, 'guess': 1.0},
        _ROBOTS,
    ),
    System(
        plants.penstock,
        {'seconds': 1500.0, 'friction': 0.003, 'area': 100.0, 'slow': 6.0, 'halt': 1e6},
        _ROBOTS,
    ),
)  # fmt: skip
#: The systems that MuJoCo simulates.
MUJOCO = (
    System(
        bodies.twinrotor, {'seconds': 60.0, 'low': 0.03, 'friction': 0.03, 'weak': 1.0}, _ROBOTS
    ),
    System(
        bodies.cubli,
        {'seconds': 50.0, 'wheel': 0.0004, 'damping': 0.004, 'stuck': 0.0, 'steps': 1.0},
        _ROBOTS,
    ),
)
_ALL = _OWN + (MUJOCO if AVAILABLE else ())
SYSTEMS = {system.name: system for system in _ALL}
