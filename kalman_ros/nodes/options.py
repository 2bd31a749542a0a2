# SPDX-License-Identifier: Apache-2.0
"""What each node may be told beside the scenario. Every node knows the names of all of them.

Nodes share one parameter file, so a name that belongs to another node is no mistake, and a name
that belongs to none is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from kalman_ros.core import About, options_of

#: What some filters may be told; named here so that no node has to load the filters.
FILTER_OPTIONS = ('alpha', 'beta', 'kappa', 'observer_poles')

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

    filter: Annotated[str, About('kf, ekf, ukf, steady_state or luenberger')] = 'kf'
    implementation: Annotated[str, About('native, or filterpy for a cross-check')] = 'native'
    lockstep: Lockstep = False
    publish_rate: Annotated[
        float,
        About(
            'estimates a second, predicted to now; 0 for one at each reading', 'Hz', minimum=0.0
        ),
    ] = 0.0
    initialize: Annotated[
        str, About("start from the initial 'belief' or from the first 'reading'")
    ] = 'belief'
    window: Annotated[
        float, About('late readings are still fused if no older than this', 's', 0.0, live=True)
    ] = 1.0
    gate: Annotated[
        float,
        About(
            'probability with which a good reading passes the gate; 1 for no gate',
            minimum=0.5,
            maximum=1.0,
            live=True,
        ),
    ] = 1.0
    gate_recover_after: Annotated[
        int,
        About(
            'rejections of a sensor in a row after which the covariance is widened; 0 for never',
            minimum=0,
            live=True,
        ),
    ] = 20
    restart_after: Annotated[
        int,
        About(
            'readings older than the window in a row that mean the clock went back; 0 for never',
            minimum=0,
            live=True,
        ),
    ] = 10
    max_gap: Annotated[
        float,
        About('silence after which the estimator starts anew; 0 for never', 's', 0.0, live=True),
    ] = 60.0
    future_tolerance: Annotated[
        float, About('how far ahead of now a stamp may be', 's', minimum=0.0, live=True)
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
    """Return the names of the options of every node, whichever filter the estimator runs."""
    own = {option.name for options in ALL for option in options_of(options)}
    return own | set(FILTER_OPTIONS)
