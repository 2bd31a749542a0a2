# SPDX-License-Identifier: Apache-2.0
"""The systems of the thirteenth set.

``seconds`` is the length of a recording of each; the other parameters are those of its simulator.
"""

from __future__ import annotations

from pathlib import Path

from ..systems import System
from . import plants, vehicles

_ROBOTS = Path(__file__).with_name('robots')
_ALL = (
    System(
        vehicles.scrubber, {'seconds': 120.0, 'tag': -0.4, 'lag': 0.3, 'halt': 1e6}, _ROBOTS
    ),
    System(vehicles.snowcat, {'seconds': 120.0, 'antenna': 1.5}, _ROBOTS),
    System(vehicles.hullbot, {'seconds': 60.0, 'prism': 0.35}, _ROBOTS),
    System(
        vehicles.striker, {'seconds': 30.0, 'lag': 0.15, 'least': 0.0, 'shoves': 1.0}, _ROBOTS
    ),
    System(vehicles.patrol, {'seconds': 240.0, 'zigzag': 1.0}, _ROBOTS),
    System(
        plants.skycam,
        {'seconds': 90.0, 'lag': 0.6, 'x_b': 60.0, 'wind': 0.0, 'lift': 1.0},
        _ROBOTS,
    ),
    System(
        plants.ventilator,
        {'seconds': 90.0, 'resistance': 8.0, 'leak': 0.002, 'hold': 1e6},
        _ROBOTS,
    ),
    System(
        plants.coldstore,
        {'seconds': 21600.0, 'coil': 2.0, 'worn': 1.0, 'halt': 1e6},
        _ROBOTS,
    ),
    System(
        plants.softfinger,
        {'seconds': 60.0, 'stiffness': 40.0, 'leak': 0.8, 'least': 0.0, 'halt': 1e6},
        _ROBOTS,
    ),
    System(
        plants.tumbler,
        {'seconds': 240.0, 'inertia': 0.035, 'friction': 0.02, 'coil_y': 1.0},
        _ROBOTS,
    ),
)  # fmt: skip
SYSTEMS = {system.name: system for system in _ALL}
