# SPDX-License-Identifier: Apache-2.0
"""What the sensors of a scenario can tell of its state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalman_ros.control.structure import describe, observed, uncontrollable_modes
from kalman_ros.core import DesignError, linearize

from .scenario import Scenario


@dataclass(frozen=True)
class Observability:
    """The states that the enabled sensors determine, and those that they do not."""

    seen: tuple[str, ...]
    unseen: tuple[str, ...]

    def __str__(self) -> str:
        seen = f'the sensors observe {", ".join(self.seen) or "nothing"}'
        return f'{seen}; not {", ".join(self.unseen)}' if self.unseen else seen


def observability(scenario: Scenario) -> Observability:
    """Return what the sensors observe, with model and sensors linearised about the first belief.

    Raises
    ------
    DesignError
        If a mode that grows is seen by no sensor: no filter can follow it.
    """
    model, x = scenario.model, scenario.initial_belief.mean
    system = linearize(model, x, np.zeros(model.input.size))
    sensors = [source.sensor for source in scenario.enabled.values()]
    C = np.vstack([np.empty((0, x.size)), *(sensor.jacobian(x) for sensor in sensors)])
    mask = observed(system.A, C)
    names = model.state.names
    found = Observability(
        tuple(name for name, there in zip(names, mask) if there),
        tuple(name for name, there in zip(names, mask) if not there),
    )
    modes = uncontrollable_modes(system.A.T, C.T)
    growing = modes[modes.real > 1e-9]
    if growing.size:
        raise DesignError(
            f'sensors: no sensor sees the growing mode at {describe(growing)} per second; {found}'
        )
    return found
