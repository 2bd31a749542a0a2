# SPDX-License-Identifier: Apache-2.0
"""The systems of the third set; those of MuJoCo are only here where it can be imported.

``seconds`` is the length of a recording of each; the other parameters are those of its simulator.
"""

from __future__ import annotations

from pathlib import Path

from ..systems import System
from . import bodies, plants, vehicles

_ROBOTS = Path(__file__).with_name('robots')
_OWN = (
    System(
        vehicles.forklift,
        {'seconds': 100.0, 'wheelbase': 1.4, 'radius': 0.15, 'scanner': 0.0},
        _ROBOTS,
    ),
    System(
        vehicles.hovercraft, {'seconds': 100.0, 'drag': 3.0, 'antenna': 0.0, 'shove': 0.0}, _ROBOTS
    ),
    System(vehicles.glider, {'seconds': 90.0, 'drag': 0.02}, _ROBOTS),
    System(vehicles.walker, {'seconds': 100.0}, _ROBOTS),
    System(vehicles.rov, {'seconds': 120.0, 'mass': 90.0, 'drag': 60.0, 'astern': 1.0}, _ROBOTS),
    System(
        plants.boom,
        {'seconds': 80.0, 'gain': 0.5, 'sinking': 1.0, 'overlap': 0.0, 'radius': 0.4},
        _ROBOTS,
    ),
    System(plants.heater, {'seconds': 120.0, 'blown': 1.8, 'room': 20.0}, _ROBOTS),
    System(plants.conveyor, {'seconds': 90.0}, _ROBOTS),
    System(plants.battery, {'seconds': 120.0, 'capacity': 7200.0, 'resistance': 0.03}, _ROBOTS),
)
#: The systems that MuJoCo simulates.
MUJOCO = (
    System(bodies.gimbal, {'seconds': 60.0, 'friction': 0.01}, _ROBOTS),
    System(bodies.cartpole, {'seconds': 60.0, 'pole_mass': 0.3, 'friction': 0.8}, _ROBOTS),
    System(bodies.drone, {'seconds': 60.0, 'antenna_forward': 0.0, 'antenna_up': 0.0}, _ROBOTS),
)
_ALL = _OWN + (MUJOCO if bodies.AVAILABLE else ())
SYSTEMS = {system.name: system for system in _ALL}
