# SPDX-License-Identifier: Apache-2.0
"""The systems of the fourth set.

``seconds`` is the length of a recording of each; the other parameters are those of its simulator.
"""

from __future__ import annotations

from pathlib import Path

from ..systems import System
from . import plants, vehicles

_ROBOTS = Path(__file__).with_name('robots')
_ALL = (
    System(vehicles.shuttle, {'seconds': 90.0, 'anchor': 9.0}, _ROBOTS),
    System(
        vehicles.tractor,
        {'seconds': 104.0, 'wheelbase': 2.8, 'implement': 4.0, 'antenna_left': 0.0},
        _ROBOTS,
    ),
    System(vehicles.mecanum, {'seconds': 90.0}, _ROBOTS),
    System(vehicles.aeroplane, {'seconds': 120.0}, _ROBOTS),
    System(
        vehicles.auv,
        {'seconds': 100.0, 'buoyancy': 5.0, 'drag': 40.0, 'nose': 0.0, 'aft': 1.0},
        _ROBOTS,
    ),
    System(plants.manipulator, {'seconds': 60.0, 'mass_2': 2.0, 'friction': 0.6}, _ROBOTS),
    System(
        plants.balancer, {'seconds': 60.0, 'height': 0.25, 'stuck': 0.0, 'ahead': 1.0}, _ROBOTS
    ),
    System(
        plants.suspension,
        {'seconds': 40.0, 'damping': 1200.0, 'road': 0.0002, 'gain': 1.0},
        _ROBOTS,
    ),
    System(plants.altitude, {'seconds': 90.0}, _ROBOTS),
    System(plants.vessel, {'seconds': 120.0, 'camera': 400.0}, _ROBOTS),
)
SYSTEMS = {system.name: system for system in _ALL}
