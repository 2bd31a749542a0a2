# SPDX-License-Identifier: Apache-2.0
"""A model with its default wiring: sensors, topics, cost and first belief."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from .model import Model
from .options import Value


@dataclass(frozen=True)
class Signal:
    """Where a vector is found on the wire: a topic, a message type, a field a coordinate.

    Parameters
    ----------
    topic
        A topic name; relative names follow the node's namespace and remaps.
    type
        A message type, ``package/Name``.
    fields
        A dotted path a coordinate, ``pose.pose.position.x``; ``position[NAME]`` finds a name
        among the message's names, ``data[3]`` an element, ``poses[2].position.x`` what is in
        one, ``orientation.yaw`` an angle.
    covariance
        The path of an array with the covariance of exactly these coordinates, row by row. Left
        empty, it is taken from the covariance that the message type itself carries, if any.
    """

    topic: str
    type: str
    fields: tuple[str, ...]
    covariance: str = ''


#: The input of a model that has none.
NO_INPUT = Signal('input', 'std_msgs/Float64MultiArray', ())


@dataclass(frozen=True)
class SensorSetup:
    """One sensor of a system: its kind, what it reads, how often, how well, and where.

    ``kind`` is the name of a file in ``kalman_ros.sensors`` or a ``package.module:Class``;
    ``options`` are passed to it. ``noise`` are standard deviations, ``rate`` is in Hz.
    """

    kind: str
    signal: Signal
    noise: tuple[float, ...]
    rate: float
    options: Mapping[str, Value] = field(default_factory=dict)
    enabled: bool = True


@dataclass(frozen=True)
class System:
    """A model with everything that the nodes need to run it without a single parameter.

    Parameters
    ----------
    build
        Returns the `Model`; its keyword arguments are the model's parameters.
    sensors
        By name, in the order in which readings of one instant are fused.
    state
        Signal of the state (``estimate``, ``ground_truth``, ``reference``); its topic is that
        of the estimate.
    initial_state
        Where the plant starts.
    initial_std
        Standard deviations of the estimator's first belief.
    initial_estimate
        The mean of that belief; the equilibrium if it is left empty.
    input
        Signal of the input; a model without inputs has none, and needs no controller.
    state_cost, input_cost
        Default LQR weights of the continuous cost, diagonals; for a model with inputs.
    filter
        The filter that suits model and sensors, unless told otherwise.
    """

    build: Callable[..., Model]
    sensors: Mapping[str, SensorSetup]
    state: Signal
    initial_state: tuple[float, ...]
    initial_std: tuple[float, ...]
    initial_estimate: tuple[float, ...] = ()
    input: Signal = NO_INPUT
    state_cost: tuple[float, ...] = ()
    input_cost: tuple[float, ...] = ()
    filter: str = 'kf'
