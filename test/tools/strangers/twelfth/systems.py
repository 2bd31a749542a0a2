# SPDX-License-Identifier: Apache-2.0
"""The systems of the twelfth set.

``seconds`` is the length of a recording of each; the other parameters are those of its simulator.
"""

from __future__ import annotations

from pathlib import Path

from ..systems import System
from . import plants, vehicles

_ROBOTS = Path(__file__).with_name('robots')
_ALL = (
    System(
        vehicles.docent, {'seconds': 90.0, 'x_c': -2.0, 'track': 1.0, 'halt': 1e6}, _ROBOTS
    ),
    System(vehicles.valet, {'seconds': 60.0, 'lag': 0.35, 'left': 1.0}, _ROBOTS),
    System(vehicles.gokart, {'seconds': 60.0, 'y_b': 60.0, 'tread': 1.0}, _ROBOTS),
    System(vehicles.sprayer, {'seconds': 60.0, 'fore': 0.9}, _ROBOTS),
    System(
        vehicles.minisub,
        {'seconds': 100.0, 'buoyancy': 3.0, 'drag': 25.0, 'fore': 1.0, 'weak': 1.0},
        _ROBOTS,
    ),
    System(
        plants.rotator,
        {
            'seconds': 60.0, 'inertia': 0.05, 'constant': 0.4, 'least': 0.0, 'gusts': 1.0,
            'halt': 1e6,
        },
        _ROBOTS,
    ),
    System(
        plants.quadtank,
        {'seconds': 1200.0, 'outlet': 0.1, 'split': 0.6, 'worn': 1.0, 'halt': 1e6},
        _ROBOTS,
    ),
    System(
        plants.solar, {'seconds': 14400.0, 'glass': 0.75, 'loss': 12.0, 'flow': 1.0}, _ROBOTS
    ),
    System(
        plants.dialysis,
        {'seconds': 14400.0, 'membranes': 0.01, 'growth': 0.006, 'clears': 1.0, 'refills': 1e-4},
        _ROBOTS,
    ),
    System(
        plants.skyscraper,
        {'seconds': 120.0, 'spring': 1.6, 'oil': 12.0, 'weak': 1.0, 'storm': 1.0},
        _ROBOTS,
    ),
)  # fmt: skip
SYSTEMS = {system.name: system for system in _ALL}
