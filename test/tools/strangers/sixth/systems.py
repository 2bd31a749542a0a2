# SPDX-License-Identifier: Apache-2.0
"""The systems of the sixth set.

``seconds`` is the length of a recording of each; the other parameters are those of its simulator.
"""

from __future__ import annotations

from pathlib import Path

from ..systems import System
from . import plants, vehicles

_ROBOTS = Path(__file__).with_name('robots')
_CYLINDER = {'seconds': 30.0, 'mass': 200.0, 'oil': 2000.0, 'leak': 2.0, 'overlap': 0.0}
_ALL = (
    System(vehicles.mower, {'seconds': 120.0, 'antenna': 0.3}, _ROBOTS),
    System(vehicles.dog, {'seconds': 40.0, 'ahead': 0.0, 'turned': 0.0}, _ROBOTS),
    System(vehicles.bus, {'seconds': 600.0}, _ROBOTS),
    System(vehicles.kite, {'seconds': 60.0, 'antenna': 0.0, 'winch': 0.0}, _ROBOTS),
    System(vehicles.sailboat, {'seconds': 240.0, 'drag': 0.09, 'rudder': 1.0}, _ROBOTS),
    System(plants.knee, {'seconds': 30.0, 'stiffness': 150.0, 'weight': 12.0}, _ROBOTS),
    System(plants.cylinder, {**_CYLINDER, 'rest': 0.0}, _ROBOTS),
    System(plants.greenhouse, {'seconds': 3600.0, 'glass': 1 / 1500, 'door': 0.0}, _ROBOTS),
    System(plants.buoy, {'seconds': 180.0, 'heave': 0.7, 'sea': 0.08}, _ROBOTS),
    System(plants.stage, {'seconds': 30.0, 'mass': 20.0, 'spring': 800.0, 'hose': 0.0}, _ROBOTS),
)
SYSTEMS = {system.name: system for system in _ALL}
