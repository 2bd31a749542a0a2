# SPDX-License-Identifier: Apache-2.0
"""A plant in sampled time, with process noise and noisy sensors at rates of their own."""

from __future__ import annotations

from collections.abc import Mapping

from kalman_ros.core import Array, Model, TimedSensor, is_due, ratio

from .noise import NoiseSource


class SimulatedPlant:
    """The truth: a model that moves step by step, and the readings that it gives off.

    Parameters
    ----------
    model
        How the state moves.
    sensors
        By name, in the order in which they read.
    rate
        Steps a second.
    initial_state
        The state (n,) at step 0.
    seed
        Of all noise.
    """

    def __init__(
        self,
        model: Model,
        sensors: Mapping[str, TimedSensor],
        rate: float,
        initial_state: Array,
        seed: int,
    ) -> None:
        self.dt = 1.0 / rate
        self.rate = rate
        self.steps = 0
        self.state = initial_state
        self._read: dict[str, Array] | None = None
        self._seed = seed
        self._process_noise = NoiseSource(seed, 'process')
        self._sensor_noise: dict[str, NoiseSource] = {}
        self.configure(model, sensors)

    def configure(self, model: Model, sensors: Mapping[str, TimedSensor]) -> None:
        """Replace the model or the sensors from now on; noise streams go on."""
        shares = {name: ratio(timed.rate, self.rate) for name, timed in sensors.items()}
        self.model, self.sensors, self._shares = model, dict(sensors), shares
        for name in sensors:
            if name not in self._sensor_noise:
                self._sensor_noise[name] = NoiseSource(self._seed, f'sensor {name}')

    def step(self, u: Array) -> None:
        """Move on by one step with the input ``u`` (m,) held, and draw its process noise."""
        model, x = self.model, self.state
        noise = self._process_noise.draw(model.transition(x, u, self.dt).Q)
        self.state = model.state.wrap(model.step(x, u, self.dt) + noise)
        self.steps += 1
        self._read = None

    def readings(self) -> dict[str, Array]:
        """Return the noisy readings that are due at this step; asked again, the same."""
        if self._read is None:
            self._read = self._fresh_readings()
        return self._read

    def _fresh_readings(self) -> dict[str, Array]:
        result = {}
        for name, timed in self.sensors.items():
            if timed.enabled and is_due(self.steps, self._shares[name]):
                sensor = timed.sensor
                noise = self._sensor_noise[name].draw(sensor.covariance)
                result[name] = sensor.output.wrap(sensor.measure(self.state) + noise)
        return result
