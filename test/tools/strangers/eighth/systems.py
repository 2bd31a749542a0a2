# SPDX-License-Identifier: Apache-2.0
"""The systems of the eighth set.

``seconds`` is the length of a recording of each; the other parameters are those of its simulator.
"""

from __future__ import annotations

from pathlib import Path

from ..systems import System
from . import plants, vehicles

_ROBOTS = Path(__file__).with_name('robots')
_ALL = (
    System(vehicles.wheelchair, {'seconds': 100.0, 'halt': 1e6}, _ROBOTS),
    System(
        vehicles.ebike, {'seconds': 200.0, 'mass': 100.0, 'area': 0.5, 'rolling': 0.008}, _ROBOTS
    ),
    System(vehicles.kiwi, {'seconds': 60.0, 'marker': 0.0, 'least': 0.0}, _ROBOTS),
    System(vehicles.hexacopter, {'seconds': 60.0, 'antenna': 0.0, 'shaking': 1.0}, _ROBOTS),
    System(vehicles.cyclist, {'seconds': 120.0}, _ROBOTS),
    System(
        plants.turntable,
        {
            'seconds': 30.0, 'inertia': 0.02, 'resistance': 1.2, 'lost': 0.0, 'back': 1.0,
            'halt': 1e6,
        },
        _ROBOTS,
    ),
    System(
        plants.shaker, {'seconds': 30.0, 'mass': 12.0, 'spring': 4800.0, 'damper': 48.0}, _ROBOTS
    ),
    System(plants.canal, {'seconds': 600.0, 'culvert': 0.5, 'thief': 0.0}, _ROBOTS),
    System(
        plants.reactor,
        {'seconds': 900.0, 'rate': 0.01, 'transfer': 0.02, 'feed_temperature': 20.0},
        _ROBOTS,
    ),
    System(plants.hydrofoil, {'seconds': 60.0, 'bow': 1.5, 'stiff': 4.0, 'sea': 1.0}, _ROBOTS),
)  # fmt: skip
SYSTEMS = {system.name: system for system in _ALL}
