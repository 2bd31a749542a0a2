# SPDX-License-Identifier: Apache-2.0
"""The systems of the seventh set.

``seconds`` is the length of a recording of each; the other parameters are those of its simulator.
"""

from __future__ import annotations

from pathlib import Path

from ..systems import System
from . import plants, vehicles

_ROBOTS = Path(__file__).with_name('robots')
_ALL = (
    System(vehicles.weeder, {'seconds': 90.0, 'antenna': 0.3, 'halt': 1e3}, _ROBOTS),
    System(vehicles.trolley, {'seconds': 120.0, 'mass': 40.0, 'friction': 8.0}, _ROBOTS),
    System(
        vehicles.yacht, {'seconds': 180.0, 'leeway': 1.5, 'drag': 0.2, 'masthead': 0.0}, _ROBOTS
    ),
    System(vehicles.parafoil, {'seconds': 90.0, 'airspeed': 11.0, 'response': 0.5}, _ROBOTS),
    System(vehicles.horse, {'seconds': 200.0, 'mast': 300.0}, _ROBOTS),
    System(plants.elbow, {'seconds': 30.0, 'mass': 3.5, 'spring': 120.0, 'play': 0.0}, _ROBOTS),
    System(plants.ram, {'seconds': 30.0, 'mass': 200.0, 'overlap': 0.0, 'back': 1.0}, _ROBOTS),
    System(plants.orangery, {'seconds': 600.0, 'loss': 0.01}, _ROBOTS),
    System(plants.telescope, {'seconds': 60.0, 'inertia': 10.0, 'stuck': 0.0}, _ROBOTS),
    System(plants.mixer, {'seconds': 300.0, 'outlet': 0.015, 'brine': 10.0}, _ROBOTS),
)
SYSTEMS = {system.name: system for system in _ALL}
