# SPDX-License-Identifier: Apache-2.0
"""A scenario: a model, its sensors, its signals and its rate, shared by all nodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from kalman_ros.core import Array, Dynamics, Gaussian, Sensor, Signal, TimedSensor, Value
from kalman_ros.core.geodesy import Place
from kalman_ros.estimators.plan import Plan

from .bias_states import Believed, Bias, believed


@dataclass(frozen=True)
class SensorSource:
    """A sensor of a scenario with its topic."""

    timed: TimedSensor
    signal: Signal
    covariance_from: str
    reliable: bool
    gate: float
    #: What an estimator believes of its bias; None for no bias.
    bias: Bias | None = None
    #: Probability that a valid reading counts in full; 1 for all.
    soft_gate: float = 1.0
    #: Whether the noise follows the innovations.
    adapt: bool = False

    @property
    def sensor(self) -> Sensor:
        """The sensor model."""
        return self.timed.sensor

    @property
    def weights(self) -> list[str]:
        """The options that are given by which the noise of a reading depends on its innovation."""
        given = {'soft_gate': self.soft_gate < 1.0, 'adapt': self.adapt}
        return [option for option, is_given in given.items() if is_given]

    @property
    def judged(self) -> bool:
        """Whether its innovations scatter as expected of a consistent filter.

        Those of readings of zero do not: no sensor took them.
        """
        return not self.signal.zero

    def used(self, carried: Array | None) -> Array | None:
        """Return the covariance (k, k) to use for a reading; None for the configured one.

        ``carried`` is the covariance in its message, None if there is none. Of its coordinates
        with nothing but zeros the covariance is unknown (the comments of sensor_msgs/Imu): there
        the configured one is used.
        """
        if carried is None or self.covariance_from == 'configuration':
            return None
        if not carried.diagonal().all():
            known = carried.any(axis=0)
            carried = np.where(np.outer(known, known), carried, self.sensor.covariance)
        if self.covariance_from == 'message':
            return carried
        return carried if carried.trace() > self.sensor.covariance.trace() else None


@dataclass(frozen=True, eq=False, repr=False)
class Scenario:
    """A model, its sensors, its signals and its rate, built and checked as a whole.

    Parameters
    ----------
    model
        The model of the robot.
    sensors
        By name, the sensors, each with its topic and its rate.
    state, input
        The topics of the state and of the input, and the fields in them.
    rate
        Of the loop, in Hz.
    initial_state
        At which the plant begins (n,).
    initial_belief
        Of the estimator, at the first reading.
    state_cost, input_cost
        Weights (n, n) and (m, m) of the regulator.
    filter, filter_options
        Name of the filter, and those of its options that are given.
    law, law_options
        Name of the law, '' without one, and its options.
    datum
        The origin of satellite fixes in metres; None for the first one.
    """

    model: Dynamics
    sensors: Mapping[str, SensorSource]
    state: Signal
    input: Signal
    rate: float
    initial_state: Array
    initial_belief: Gaussian
    state_cost: Array
    input_cost: Array
    filter: str
    law: str
    law_options: Mapping[str, Value]
    filter_options: Mapping[str, Value] = field(default_factory=dict)
    datum: Place | None = None

    def __repr__(self) -> str:
        """Return model, states, input, sensors and rate in five lines."""
        law = f', law {self.law}' if self.law else ''
        sensors = '; '.join(
            f'{name}: {source.sensor.output} at {source.timed.rate:g} Hz'
            + ('' if source.timed.enabled else ', disabled')
            for name, source in self.sensors.items()
        )
        lines = {
            'states': self.model.state,
            'input': self.model.input,
            'sensors': sensors or 'none',
            'initial': f'mean {self.initial_belief.mean.tolist()}, '
            f'std {self.initial_belief.std.tolist()}',
        }
        head = f'{type(self.model).__name__} at {self.rate:g} Hz, filter {self.filter}{law}'
        return '\n'.join((head, *(f'{name}: {line}' for name, line in lines.items())))

    @property
    def plan(self) -> Plan:
        """The input for building a filter: the model and the enabled sensors."""
        timed = {name: source.timed for name, source in self.enabled.items()}
        return Plan(self.model, timed, self.rate)

    @cached_property
    def believed(self) -> Believed:
        """What an estimator computes with, which has the biases of sensors as states, too."""
        sensors = {name: source.sensor for name, source in self.sensors.items()}
        biases = {n: source.bias for n, source in self.sensors.items() if source.bias is not None}
        return believed(self.model, sensors, self.initial_belief, biases)

    @cached_property
    def without_biases(self) -> Scenario:
        """The same scenario with sensors of which no bias is believed."""
        sources = {name: replace(source, bias=None) for name, source in self.sensors.items()}
        return replace(self, sensors=sources)

    @property
    def believed_plan(self) -> Plan:
        """The input for building an estimator's filter: the `plan` with the biases."""
        return self.plan.computed_by(self.believed.model, self.believed.sensors)

    @property
    def timed(self) -> dict[str, TimedSensor]:
        """The sensors with their rates, disabled ones included."""
        return {name: source.timed for name, source in self.sensors.items()}

    @property
    def enabled(self) -> dict[str, SensorSource]:
        """The enabled sensors."""
        return {name: source for name, source in self.sensors.items() if source.timed.enabled}
