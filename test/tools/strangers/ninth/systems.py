# SPDX-License-Identifier: Apache-2.0
"""The systems of the ninth set.

``seconds`` is the length of a recording of each; the other parameters are those of its simulator.
"""

from __future__ import annotations

from pathlib import Path

from ..systems import System
from . import plants, vehicles

_ROBOTS = Path(__file__).with_name('robots')
_ALL = (
    System(vehicles.inspector, {'seconds': 60.0, 'ahead': 0.0}, _ROBOTS),
    System(
        vehicles.loader, {'seconds': 100.0, 'antenna': 0.6, 'rear': 1.5, 'stuck': 0.0}, _ROBOTS
    ),
    System(
        vehicles.agv, {'seconds': 90.0, 'x_b': 14.0, 'weak': 1.0, 'halt': 1e6}, _ROBOTS
    ),
    System(vehicles.jetski, {'seconds': 120.0, 'antenna': 0.0}, _ROBOTS),
    System(vehicles.bed, {'seconds': 60.0, 'behind': 0.8, 'rough': 1.0}, _ROBOTS),
    System(
        vehicles.aerostat, {'seconds': 300.0, 'level': 70.0, 'burner': 1.5, 'loss': 120.0}, _ROBOTS
    ),
    System(plants.mill, {'seconds': 30.0, 'roll': 2.0, 'shaft': 200.0, 'slab': 0.0}, _ROBOTS),
    System(plants.microgrid, {'seconds': 90.0, 'coil': 0.5, 'store': 4.0, 'leak': 0.0}, _ROBOTS),
    System(plants.footbridge, {'seconds': 90.0, 'first': 6.0, 'crowd': 1.0}, _ROBOTS),
    System(
        plants.infusion, {'seconds': 2400.0, 'clearance': 0.002, 'half': 3.4, 'pump': 1.0}, _ROBOTS
    ),
)  # fmt: skip
SYSTEMS = {system.name: system for system in _ALL}
