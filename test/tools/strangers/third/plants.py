# SPDX-License-Identifier: Apache-2.0
"""Plants and machines: an excavator's boom, a heater with a fan, a conveyor and a battery.

Their inputs follow schedules, or what a controller sees with errors.
"""

from __future__ import annotations

import math

import numpy as np

from ..second.vehicles import GRAVITY, Physics
from ..simulation import Array, Readings, Vector, column, commanded, integrate, sampled, square


def boom(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return eighty seconds of a boom that digs, between 0 and 1 rad above the horizon.

    ``sinking`` is the gain of its valve downwards by the one upwards; openings below ``overlap``
    pass no oil.
    """
    gain, sinking, radius = physics['gain'], physics['sinking'], physics['radius']
    overlap = physics['overlap']

    def rates(x: Vector, u: Vector) -> Vector:
        opened = math.copysign(max(abs(u[0]) - overlap, 0.0), u[0])
        wish = gain * opened * (sinking if u[0] < 0.0 else 1.0)
        return x[1], (wish - x[1]) / 0.35

    def dig(t: float, x: Vector) -> Vector:
        target = 0.5 + 0.35 * square(t, 9.0) + 0.12 * math.sin(1.3 * t)
        return (min(1.0, max(-1.0, 3.0 * (target - x[0] + rng.normal(0.0, 0.02)))),)

    def imu(x: Array) -> list[Array | float]:
        along = GRAVITY * np.sin(x[0]) - radius * x[1] ** 2
        return [0, x[1], 0, along, 0, GRAVITY * np.cos(x[0])]

    def length(x: Array) -> list[Array]:
        return [np.sqrt(0.6**2 + 1.8**2 - 2.0 * 0.6 * 1.8 * np.cos(x[0] + 1.2))]

    start = rng.normal([0.4, 0.0], [0.05, 0.05])
    truth = integrate(rates, start, [0, 0.003], physics['seconds'], 0.004, rng, dig, 0.1)
    return {
        'imu': sampled(truth, 'imu', 'imu', 50.0, imu, [0.01] * 3 + [0.12] * 3, rng),
        'cylinder': sampled(truth, 'cylinder', 'range', 12.5, length, [0.003], rng),
        'input': commanded(truth, 'valve', 'force'),
    }


def heater(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two minutes of a heated plate and the air that a fan blows over it."""
    blown, room = physics['blown'], physics['room']

    def rates(x: Vector, u: Vector) -> Vector:
        passed = (0.6 + blown * u[1]) * (x[0] - x[1])
        return (u[0] - passed) / 40.0, (passed - (0.8 + 1.5 * u[1]) * (x[1] - room)) / 25.0

    def heat(t: float, x: Vector) -> Vector:
        return 45.0 + 35.0 * square(t, 34.0), 0.5 + 0.45 * square(t + 6.0, 22.0)

    start = rng.normal([40.0, 28.0], [2.0, 1.0])
    truth = integrate(rates, start, [0.01, 0.01], physics['seconds'], 0.01, rng, heat, 0.5)
    return {
        'plate': sampled(truth, 'plate', 'temperature', 5.0, column(0), [0.3], rng),
        'air': sampled(truth, 'air', 'temperature', 4.0, column(1), [0.2], rng),
        'input': commanded(truth, 'power', 'numbers'),
    }


def conveyor(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of a belt, whose drive follows a speed as a lag of 0.5 s."""

    def rates(x: Vector, u: Vector) -> Vector:
        return x[1], (u[0] - x[1]) / 0.5

    def run(t: float, x: Vector) -> Vector:
        return (0.6 + 0.4 * square(t, 13.0) + 0.15 * math.sin(1.1 * t),)

    start = rng.normal([0.0, 0.5], [0.02, 0.1])
    truth = integrate(rates, start, [0, 0.01], physics['seconds'], 0.004, rng, run, 0.1)
    return {
        'encoder': sampled(truth, 'roller', 'turning', 50.0, lambda x: [x[1] / 0.06], [0.4], rng),
        'laser': sampled(truth, 'laser', 'speed', 25.0, column(1), [0.02], rng),
        'marks': sampled(truth, 'marks', 'point', 5.0, lambda x: [x[0], 0], [0.01, 0], rng),
        'input': commanded(truth, 'speed', 'speed'),
    }


def battery(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two minutes of a battery under the load of a drone, from 90 % downwards."""
    capacity, resistance = physics['capacity'], physics['resistance']

    def rates(x: Vector, u: Vector) -> Vector:
        current, _, lag, temperature = x
        warmed = resistance * current**2 + lag * current - 1.2 * (temperature - 20.0)
        return (
            (u[0] - current) / 0.4, -current / capacity, (0.02 * current - lag) / 10.0,
            warmed / 250.0,
        )  # fmt: skip

    def load(t: float, x: Vector) -> Vector:
        return (26.0 + 14.0 * square(t, 17.0) + 8.0 * math.sin(0.9 * t),)

    def voltage(x: Array) -> list[Array]:
        rest = 20.4 + 4.2 * x[1] + 0.6 * np.exp(-8.0 * (1.0 - x[1]))
        return [rest - resistance * x[0] - x[2]]

    start = rng.normal([10.0, 0.9, 0.2, 25.0], [2.0, 0.02, 0.05, 0.5])
    density = [2.0, 1e-8, 1e-5, 1e-3]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng, load, 0.1)
    return {
        'terminals': sampled(truth, 'battery', 'battery', 10.0, voltage, [0.02], rng),
        'shunt': sampled(truth, 'shunt', 'point', 20.0, lambda x: [x[0], 0], [0.5, 0], rng),
        'thermistor': sampled(truth, 'cells', 'temperature', 2.0, column(3), [0.2], rng),
        'input': commanded(truth, 'demand', 'force'),
    }
