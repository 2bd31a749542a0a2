# SPDX-License-Identifier: Apache-2.0
"""What each node may be told beside the scenario. Every node knows the names of all of them.

Nodes share one parameter file, so a name that belongs to another node is no mistake, and a name
that belongs to none is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from kalman_ros.core import About, options_of

Lockstep = Annotated[
    bool, About('step in turns with the other nodes instead of in real time; for tests')
]
Frame = Annotated[str, About('frame in which positions are given')]


@dataclass(frozen=True)
class PlantOptions:
    """Options of the plant."""

    seed: Annotated[int, About('seed of all noise', minimum=0)] = 0
    lockstep: Lockstep = False
    lockstep_timeout: Annotated[
        float, About('how long to wait for an answer before saying so', 's', minimum=1e-3)
    ] = 2.0
    force_timeout: Annotated[
        float, About('real time: the input goes to zero when none came so long', 's', minimum=0.0)
    ] = 0.5
    run_until: Annotated[
        float, About('seconds of simulated time after which to pause', 's', live=True)
    ] = 1e9
    frame: Frame = 'map'
    child_frame: Annotated[str, About('frame of the body')] = 'base_link'


@dataclass(frozen=True)
class EstimatorOptions:
    """Options of the estimator."""

    filter: Annotated[str, About('kind of filter')] = 'kf'
    lockstep: Lockstep = False
    window: Annotated[
        float, About('late readings are still fused if no older than this', 's', minimum=0.0)
    ] = 1.0
    gate: Annotated[
        float,
        About(
            'probability with which a good reading passes the gate; 1 for no gate',
            minimum=0.5,
            maximum=1.0,
        ),
    ] = 1.0
    frame: Frame = 'map'
    child_frame: Annotated[str, About('frame of the body')] = 'base_link'


@dataclass(frozen=True)
class ControllerOptions:
    """Options of the controller."""

    enabled: Annotated[bool, About('whether forces are computed; else they are zero')] = True
    frame: Frame = 'map'


@dataclass(frozen=True)
class MonitorOptions:
    """Options of the monitor."""

    monitor_window: Annotated[
        int, About('estimates over which NEES and NIS are averaged', minimum=10)
    ] = 500
    confidence: Annotated[
        float,
        About('probability with which a consistent filter passes', minimum=0.5, maximum=1.0),
    ] = 0.999


ALL = (PlantOptions, EstimatorOptions, ControllerOptions, MonitorOptions)


def names() -> set[str]:
    """Return the names of the options of every node."""
    return {option.name for options in ALL for option in options_of(options)}
