# SPDX-License-Identifier: Apache-2.0
"""A plant in discrete time, with process noise and noisy sensors at individual rates."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from kalman_ros.core import Array, Dynamics, TimedSensor, is_due, is_finite, ratio

from .actuator import Actuator
from .faults.body import BodyFaults, BodyOptions
from .faults.plant_faults import PlantFaults
from .noise import NoiseSource, stream


class SimulatedPlant:
    """The truth: a model that moves step by step, and its readings.

    Parameters
    ----------
    model
        The system model.
    sensors
        Sensors by name, in the order in which they read.
    rate
        Steps per second.
    initial_state
        State (n,) at step 0.
    seed
        Seed of all noise.
    idle
        Input (m,) before the first; zero by default.
    """

    def __init__(
        self,
        model: Dynamics,
        sensors: Mapping[str, TimedSensor],
        rate: float,
        initial_state: Array,
        seed: int,
        idle: Array | None = None,
    ) -> None:
        self.dt = 1.0 / rate
        self.rate = rate
        self.steps = 0
        self.state = initial_state
        self._read: dict[str, Array] | None = None
        self._seed = seed
        m = model.input.size
        self._command: Array = np.zeros(m) if idle is None else idle
        self.actuator = Actuator(np.ones(m), before=self._command)
        #: Faults at the input.
        self.faults = BodyFaults(BodyOptions(), m)
        self._loss, self._push = stream(seed, 'fault loss'), stream(seed, 'fault disturbance')
        self._process_noise = NoiseSource(seed, 'process')
        self._sensor_noise: dict[str, NoiseSource] = {}
        self.configure(model, sensors)

    def configure(self, model: Dynamics, sensors: Mapping[str, TimedSensor]) -> None:
        """Replace the model or the sensors from now on; noise streams continue."""
        shares = {name: ratio(timed.rate, self.rate) for name, timed in sensors.items()}
        self.model, self.sensors, self._shares = model, dict(sensors), shares
        for name in sensors:
            if name not in self._sensor_noise:
                self._sensor_noise[name] = NoiseSource(self._seed, f'sensor {name}')

    @property
    def time(self) -> int:
        """Time of this step, in nanoseconds since step 0."""
        return round(self.steps * self.dt * 1e9)

    def adopt(self, faults: PlantFaults) -> None:
        """Replace the faults of actuator and body from now on."""
        delay = self.model.nearest_step(faults.delay)
        if abs(delay - faults.delay) > 1e-9:
            raise ValueError(
                f'actuator_delay: expected whole periods of {self.model.period:g} s, as the model '
                f'moves by these, got {faults.delay:g} s'
            )
        self.actuator.adopt(faults.gain, faults.delay)
        self.faults = faults.body

    def step(self, u: Array, disturbance: Array | None = None) -> None:
        """Advance by one step and draw its process noise.

        The input ``u`` (m,) is held, and passes through the actuator and its faults; a
        ``disturbance`` (m,) is added to the acting input. A state that cannot be computed is NaN,
        and from then on only time advances.
        """
        if self.finite:
            try:
                with np.errstate(all='ignore'):
                    self.state = self._propagate(u, disturbance)
            except (ArithmeticError, np.linalg.LinAlgError):
                self.state = np.full_like(self.state, np.nan)
        self.steps += 1
        self._read = None

    @property
    def finite(self) -> bool:
        """Whether the state, and its square, is finite; it never recovers."""
        return is_finite(self.state)

    def _propagate(self, u: Array, disturbance: Array | None) -> Array:
        model, x, time = self.model, self.state, self.steps * self.dt
        Q, source = model.transition(x, u, self.dt).Q, self._process_noise
        noise = source.draw(Q) if model.is_linear else source.draw_varying(Q)
        faults = self.faults if self.faults.act(time) else None
        if faults is None or not faults.lose(self._loss):
            self._command = u
        push = np.zeros_like(u) if disturbance is None else disturbance
        if faults is not None:
            push = push + faults.push(time, self.dt, self._push)
        for duration, acting in self.actuator(self._command, self.dt):
            moving = acting if faults is None else faults.moved(acting)
            x = model.step(x, moving + push, duration)
        return model.state.add(x, noise)

    def rest(self) -> None:
        """Advance time by one step while something holds the body in place."""
        self.steps += 1
        self._read = None

    def readings(self) -> dict[str, Array]:
        """Return the noisy readings due at this step; a repeated call returns the same."""
        if self._read is None:
            self._read = self._fresh_readings()
        return self._read

    def _fresh_readings(self) -> dict[str, Array]:
        result = {}
        for name, timed in self.sensors.items():
            if timed.enabled and is_due(self.steps, self._shares[name]):
                sensor = timed.sensor
                noise = self._sensor_noise[name].draw(sensor.covariance)
                result[name] = sensor.output.add(sensor.measure(self.state), noise)
        return result
