# SPDX-License-Identifier: Apache-2.0
"""The systems of the second set.

``seconds`` is the length of a recording of each; the other parameters are those of its simulator.
"""

from __future__ import annotations

from pathlib import Path

from ..systems import System
from . import plants, vehicles

_ROBOTS = Path(__file__).with_name('robots')
_ALL = (
    System(vehicles.ferry, {'seconds': 240.0, 'gain': 0.25, 'antenna': 0.0}, _ROBOTS),
    System(vehicles.crawler, {'seconds': 120.0, 'prism_left': 0.0}, _ROBOTS),
    System(vehicles.train, {'seconds': 300.0, 'mass': 50000.0}, _ROBOTS),
    System(vehicles.blimp, {'seconds': 180.0, 'cover': 0.0}, _ROBOTS),
    System(
        vehicles.taxi, {'seconds': 120.0, 'wheelbase': 2.6, 'antenna': 0.0, 'spread': 1.0}, _ROBOTS
    ),
    System(vehicles.copter, {'seconds': 120.0, 'mass': 1.5}, _ROBOTS),
    System(vehicles.diver, {'seconds': 180.0, 'mass': 60.0, 'density': 1025.0}, _ROBOTS),
    System(plants.crane, {'seconds': 120.0, 'length': 8.0}, _ROBOTS),
    System(plants.hoist, {'seconds': 90.0, 'friction': 8.0}, _ROBOTS),
    System(plants.chamber, {'seconds': 2400.0, 'cooling': 1.0}, _ROBOTS),
    System(plants.chain, {'seconds': 600.0, 'area': 0.05, 'outlet': 8e-4}, _ROBOTS),
    System(plants.rod, {'seconds': 60.0, 'radius': 0.6, 'damping': 0.3, 'start': 0.0}, _ROBOTS),
    System(plants.satellite, {'seconds': 300.0, 'inertia': 10.0, 'start': 0.4}, _ROBOTS),
    System(plants.arm, {'seconds': 60.0, 'mass': 4.0, 'friction': 1.2, 'stiction': 0.0}, _ROBOTS),
)
SYSTEMS = {system.name: system for system in _ALL}
