# SPDX-License-Identifier: Apache-2.0
"""The systems: each has a simulator, the parameters of the world, and the file of its owner."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from . import plants, vehicles
from .simulation import Readings

_ROBOTS = Path(__file__).with_name('robots')


@dataclass(frozen=True)
class System:
    """A simulated system.

    Parameters
    ----------
    simulate
        Returns its readings without a fault, by a generator and the parameters of the world.
    physics
        The true parameters that a recording may change; as here, they are those of the file.
    robots
        The folder of its parameter file.
    """

    simulate: Callable[[np.random.Generator, dict[str, float]], Readings]
    physics: dict[str, float] = field(default_factory=dict)
    robots: Path = _ROBOTS

    @property
    def name(self) -> str:
        """The name of the system."""
        return self.simulate.__name__

    @property
    def parameters(self) -> str:
        """The text of its parameter file."""
        return (self.robots / f'{self.name}.yaml').read_text()


_ALL = (
    System(vehicles.rover, {'radius': 0.1, 'track': 0.5}),
    System(vehicles.car, {'antenna_forward': -0.5, 'antenna_left': 0.4}),
    System(vehicles.boat, {'current': 0.0}),
    System(vehicles.quadrotor, {'mass': 1.0, 'drag': 0.3}),
    System(vehicles.balloon),
    System(plants.spring, {'mass': 2.0}),
    System(plants.pendulum, {'length': 0.5, 'damping': 0.4}),
    System(plants.motor),
    System(plants.elevator),
    System(plants.tank, {'valve': 0.008}),
    System(plants.oven),
)
SYSTEMS = {system.name: system for system in _ALL}
