# SPDX-License-Identifier: Apache-2.0
"""The systems of the fifth set.

``seconds`` is the length of a recording of each; the other parameters are those of its simulator.
"""

from __future__ import annotations

from pathlib import Path

from ..systems import System
from . import plants, vehicles

_ROBOTS = Path(__file__).with_name('robots')
_ALL = (
    System(vehicles.courier, {'seconds': 120.0, 'antenna_left': 0.0}, _ROBOTS),
    System(vehicles.racer, {'seconds': 60.0, 'stiffness': 35.0, 'reach': 1.0}, _ROBOTS),
    System(vehicles.scout, {'seconds': 60.0, 'drag': 0.5}, _ROBOTS),
    System(vehicles.target, {'seconds': 200.0}, _ROBOTS),
    System(vehicles.tag, {'seconds': 90.0, 'anchor': 40.0}, _ROBOTS),
    System(plants.headset, {'seconds': 40.0, 'markers': 0.0, 'turned': 0.0}, _ROBOTS),
    System(plants.gantry, {'seconds': 30.0, 'mass': 5.0, 'belt': 3000.0, 'stuck': 0.0}, _ROBOTS),
    System(plants.silo, {'seconds': 300.0}, _ROBOTS),
    System(plants.turbine, {'seconds': 120.0, 'inertia': 400.0, 'shaft': 8000.0}, _ROBOTS),
    System(plants.plate, {'seconds': 45.0, 'servo': 0.08, 'rolling': 0.2}, _ROBOTS),
)
SYSTEMS = {system.name: system for system in _ALL}
