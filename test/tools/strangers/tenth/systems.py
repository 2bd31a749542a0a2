# SPDX-License-Identifier: Apache-2.0
"""The systems of the tenth set; those of MuJoCo are only here where it can be imported.

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
        vehicles.porter, {'seconds': 90.0, 'ahead': 0.0, 'rough': 1.0, 'halt': 1e6}, _ROBOTS
    ),
    System(vehicles.truck, {'seconds': 120.0, 'antenna': -2.0}, _ROBOTS),
    System(vehicles.miner, {'seconds': 60.0, 'x_c': -6.0}, _ROBOTS),
    System(vehicles.swerve, {'seconds': 60.0, 'least': 0.0, 'halt': 1e6}, _ROBOTS),
    System(vehicles.airliner, {'seconds': 240.0, 'rough': 1.0}, _ROBOTS),
    System(vehicles.swimmer, {'seconds': 150.0}, _ROBOTS),
    System(
        plants.web,
        {'seconds': 60.0, 'stiff': 1500.0, 'brake': 1.0, 'offset': 0.0, 'halt': 1e6},
        _ROBOTS,
    ),
    System(plants.fermenter, {'seconds': 7200.0, 'growth': 1.2e-4, 'pump': 1.0}, _ROBOTS),
)  # fmt: skip
#: The systems that MuJoCo simulates.
MUJOCO = (
    System(
        bodies.furuta, {'seconds': 60.0, 'mass': 0.12, 'friction': 0.004, 'stuck': 0.0}, _ROBOTS
    ),
    System(
        bodies.isolator,
        {'seconds': 60.0, 'mass': 30.0, 'damping': 60.0, 'lean': 0.0, 'steps': 1.0},
        _ROBOTS,
    ),
)
_ALL = _OWN + (MUJOCO if AVAILABLE else ())
SYSTEMS = {system.name: system for system in _ALL}
