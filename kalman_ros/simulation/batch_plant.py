# SPDX-License-Identifier: Apache-2.0
"""The plants of many runs at once: each is a `SimulatedPlant` with a separate seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil

import numpy as np

from kalman_ros.core import Array, Dynamics, TimedSensor, is_due, is_finite, ratio
from kalman_ros.core.stacked import stacked
from kalman_ros.linear.batched import semidefinite_factor, times

from .batch_faults import BatchInput, BatchLink
from .faults.plant_faults import PlantFaults
from .noise import root, stream

#: Largest number of normal numbers that wait to be used, and of steps for which they are drawn.
_WAITING, _STEPS = 2_000_000, 512
#: Number of runs whose numbers are drawn, then sorted by steps, so that they fit a cache.
_TOGETHER = 32


class BatchNoise:
    """The standard normal numbers of one `NoiseSource` of each run, drawn in blocks.

    Parameters
    ----------
    seeds
        Seeds of the runs.
    name
        Name of the source.
    size
        Size k of one draw.
    steps
        Number of draws that are needed in all.
    factor
        Matrix (k, k) with which all draws are multiplied.
    """

    def __init__(
        self, seeds: Sequence[int], name: str, size: int, steps: int, factor: Array | None = None
    ) -> None:
        #: Size of one draw.
        self.size = size
        self._streams = [stream(seed, name) for seed in seeds]
        most = max(1, min(_STEPS, _WAITING // (len(seeds) * max(1, size))))
        steps = -(-steps // -(-steps // most))  # blocks of one length
        self._drawn = np.empty((min(_TOGETHER, len(seeds)), steps, size))
        self._block = np.empty((steps, size, len(seeds)))
        self._factor = factor
        self._next = steps

    def draw(self) -> Array:
        """Return the next vectors (runs, k), with coordinates first in memory."""
        if self._next == len(self._block):
            for first in range(0, len(self._streams), _TOGETHER):
                some = self._block[:, :, first : first + _TOGETHER]
                some[:] = self._of_runs(first).transpose(1, 2, 0)
            self._next = 0
        self._next += 1
        return np.asarray(self._block[self._next - 1].T)

    def _of_runs(self, first: int) -> Array:
        """Return the next numbers (runs, steps, k) of some runs."""
        streams = self._streams[first : first + _TOGETHER]
        drawn = self._drawn[: len(streams)]
        for generator, values in zip(streams, drawn):
            generator.standard_normal(out=values)
        if self._factor is not None:
            drawn = (drawn.reshape(-1, self.size) @ self._factor.T).reshape(drawn.shape)
        return drawn


class BatchPlant:
    """The truths of many runs: a model that moves step by step, and its readings.

    Parameters
    ----------
    model, sensors, rate
        As for `SimulatedPlant`.
    initial_state
        State (n,) at step 0, or the state of each run (runs, n).
    seeds
        Seeds of all noise, one for each run.
    steps
        Number of steps that are needed in all.
    faults
        Faults of each plant; none may make a reading late.
    """

    def __init__(
        self,
        model: Dynamics,
        sensors: Mapping[str, TimedSensor],
        rate: float,
        initial_state: Array,
        seeds: Sequence[int],
        steps: int,
        faults: PlantFaults | None = None,
    ) -> None:
        self.dt, self.steps, self.model = 1.0 / rate, 0, model
        self.sensors = {name: timed for name, timed in sensors.items() if timed.enabled}
        self._shares = {name: ratio(timed.rate, rate) for name, timed in sensors.items()}
        n = model.state.size
        #: States (runs, n).
        self.state: Array = np.broadcast_to(initial_state, (len(seeds), n)).T.copy().T
        self._stacked = stacked(model)
        factor = None
        if model.is_linear:
            factor = root(model.noise_covariance(*model.equilibrium, self.dt))
        self._process_noise = BatchNoise(seeds, 'process', n, steps, factor)
        self._sensor_noise = {
            name: BatchNoise(
                seeds,
                f'sensor {name}',
                timed.sensor.output.size,
                ceil(steps * self._shares[name]) + 1,
                root(timed.sensor.covariance),
            )
            for name, timed in self.sensors.items()
        }
        self._input = None if faults is None else BatchInput(faults, seeds)
        self._links = {
            name: BatchLink(name, seeds, timed, faults.sensors[name])
            for name, timed in self.sensors.items()
            if faults is not None and faults.disturbs(name)
        }

    @property
    def time(self) -> int:
        """Time of this step, in nanoseconds since step 0."""
        return round(self.steps * self.dt * 1e9)

    def readings(self) -> dict[str, Array]:
        """Return the noisy readings (runs, k) due at this step; call it once a step.

        A lost reading is NaN.
        """
        readings = {}
        for name, timed in self.sensors.items():
            if is_due(self.steps, self._shares[name]):
                sensor = timed.sensor
                noise = self._sensor_noise[name].draw()
                y = sensor.output.add(sensor.measure(self.state), noise)
                readings[name] = self._links[name](self.time, y) if name in self._links else y
        return readings

    def step(self, u: Array) -> None:
        """Advance by one step with inputs ``u`` (runs, m) or (m,).

        A state that cannot be computed is NaN.
        """
        x = self.state
        noise = self._process_noise.draw()
        if self._input is None and not self.model.is_linear:
            moved = self._stacked.noisy_step(x, u, self.dt, noise)
        else:
            if not self.model.is_linear:
                Q = self._stacked.step_noise(x, u, self.dt)
                noise = times(semidefinite_factor(Q), noise)
            moved = self.model.state.add(self._propagate(x, u), noise)
        if not is_finite(moved):
            # as in a single run, a state whose square is not finite stays where it is
            moving = np.isfinite(np.einsum('ij,ij->i', x, x))
            moved = np.where(moving[:, np.newaxis], moved, x)
        self.state = moved
        self.steps += 1

    def _propagate(self, x: Array, u: Array) -> Array:
        """Return the states after a step, without noise."""
        if self._input is None:
            return self._stacked.step(x, u, self.dt)
        for duration, acting in self._input(self.steps, u, self.dt):
            x = self._stacked.step(x, acting, duration)
        return x
