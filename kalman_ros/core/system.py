# SPDX-License-Identifier: Apache-2.0
"""A model with its default wiring: sensors, topics, cost and initial belief."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from .dynamics import Dynamics
from .geodesy import Place
from .mount import STRAIGHT, Mounting
from .named_options import Value
from .still import StandStill


@dataclass(frozen=True)
class Signal:
    """Place of a vector in messages: a topic, a message type, and a field for each coordinate.

    Parameters
    ----------
    topic
        A topic name; relative names follow the node's namespace and remaps.
    type
        A message type, ``package/Name``.
    fields
        A dotted path per coordinate, ``pose.pose.position.x``; ``position[NAME]`` selects by
        the message's names, ``data[3]`` an element, ``poses[2].position.x`` a field of an
        element, ``orientation.yaw`` an angle.
    covariance
        Path of an array with the covariance of exactly these coordinates, row by row; if empty,
        the covariance that the message type itself carries counts, if any.
    datum
        The origin of ``east``, ``north`` and ``up`` in a ``sensor_msgs/NavSatFix``; None for the
        first fix.
    mounting
        Mounting of the sensor on its body.
    pose
        Whether a pose is read as it is, ``absolute``, ``relative`` to the first, or as a velocity,
        ``differential``.
    zero
        Whether each message is read as zeros, whatever its fields are.
    still
        Condition on which a message is read; None for always.
    stamp_offset
        Nanoseconds that are added to the stamps of the messages.
    """

    topic: str
    type: str
    fields: tuple[str, ...]
    covariance: str = ''
    datum: Place | None = None
    mounting: Mounting = STRAIGHT
    pose: str = 'absolute'
    zero: bool = False
    still: StandStill | None = None
    stamp_offset: int = 0


#: Input of a model without inputs.
NO_INPUT = Signal('input', 'std_msgs/Float64MultiArray', ())


@dataclass(frozen=True)
class SensorSetup:
    """One sensor of a system: its kind, its signal, its noise, its rate and its topic.

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
    """A model with everything that the nodes need to run it without parameters.

    Parameters
    ----------
    build
        Function that returns the `Model` or `DiscreteModel`; its keyword arguments are the
        model's parameters.
    sensors
        Sensors by name, in the order in which readings of one instant are fused.
    state
        Signal of the state (``estimate``, ``ground_truth``, ``reference``); the topic is that
        of the estimate.
    initial_state
        State in which the plant starts.
    initial_std
        Standard deviations of the estimator's initial belief.
    initial_estimate
        Mean of that belief; the equilibrium if empty.
    input
        Signal of the input; a model without inputs has none, and needs no controller.
    state_cost, input_cost
        Default LQR weights of the continuous cost, diagonals; for a model with inputs.
    filter
        The default filter for this model and its sensors.
    """

    build: Callable[..., Dynamics]
    sensors: Mapping[str, SensorSetup]
    state: Signal
    initial_state: tuple[float, ...]
    initial_std: tuple[float, ...]
    initial_estimate: tuple[float, ...] = ()
    input: Signal = NO_INPUT
    state_cost: tuple[float, ...] = ()
    input_cost: tuple[float, ...] = ()
    filter: str = 'kf'
