# SPDX-License-Identifier: Apache-2.0
"""Plants: a camera on ropes, a ventilator, a cold store, a soft finger, and a small satellite.

Inputs are programs of time.
"""

from __future__ import annotations

import math

import numpy as np

from ..second.vehicles import Physics
from ..simulation import Array, Readings, Vector, column, commanded, integrate, sampled, square

#: Where the four pulleys of the stadium are.
_PULLEYS = (0.0, 0.0, 20.0), (60.0, 0.0, 20.0), (60.0, 40.0, 23.0), (0.0, 40.0, 18.0)


def skycam(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of a camera that hangs on four ropes in a stadium.

    It follows commanded velocities with ``lag``; the second pulley is at ``x_b``, ``wind`` is an
    acceleration along y, and ``lift`` the speed upwards by what is commanded.
    """
    lag, wind, lift = physics['lag'], physics['wind'], physics['lift']
    pulleys = (_PULLEYS[0], (physics['x_b'], *_PULLEYS[1][1:]), *_PULLEYS[2:])

    def rates(x: Vector, u: Vector) -> Vector:
        return (
            x[3], x[4], x[5],
            (u[0] - x[3]) / lag, (u[1] - x[4]) / lag + wind, (lift * u[2] - x[5]) / lag,
        )  # fmt: skip

    def fly(t: float, x: Vector) -> Vector:
        return (
            3.0 * math.cos(0.23 * t) + 1.2 * square(t + 1.0, 7.9),
            2.0 * math.cos(0.31 * t) + 1.0 * square(t, 6.1),
            0.8 * math.cos(0.41 * t) + 0.5 * square(t + 0.5, 5.3),
        )

    def ropes(x: Array) -> list[Array]:
        return [np.sqrt((a - x[0]) ** 2 + (b - x[1]) ** 2 + (c - x[2]) ** 2)
                for a, b, c in pulleys]  # fmt: skip

    start = rng.normal([28.0, 19.0, 8.0, 0, 0, 0], [0.1, 0.1, 0.1, 0.2, 0.2, 0.2])
    density = [0, 0, 0, 0.008, 0.008, 0.008]
    truth = integrate(rates, start, density, physics['seconds'], 0.005, rng, fly, 0.1)
    return {
        'ropes': sampled(truth, 'ropes', 'ranges', 10.0, ropes, [0.04] * 4, rng),
        'tracker': sampled(
            truth, 'tracker', 'triple', 5.0, lambda x: [*x[:3]], [0.03] * 3, rng
        ),
        'speed': sampled(
            truth, 'speed', 'velocity', 20.0, lambda x: [*x[3:]], [0.06] * 3, rng
        ),
        'input': commanded(truth, 'cmd', 'velocity'),
    }  # fmt: skip


def ventilator(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of lungs with two parts, which a ventilator fills.

    Pressures are in cmH2O and volumes in l. ``resistance`` is that of the first
    part, ``leak`` what leaves the hose in l/s by cmH2O, and ``hold`` when the machine holds its
    pressure for 10 s.
    """
    resistance, leak, hold = physics['resistance'], physics['leak'], physics['hold']

    def flows(x: Vector | Array) -> tuple[float, float]:
        return (x[0] - x[1] / 0.03) / resistance, (x[0] - x[2] / 0.02) / 40.0

    def rates(x: Vector, u: Vector) -> Vector:
        one, two = flows(x)
        return ((u[0] - x[0]) / 5.0 - one - two - leak * x[0]) / 0.02, one, two

    def machine(t: float, x: Vector) -> Vector:
        if hold <= t < hold + 10.0:
            return (8.0,)
        pushes = math.fmod(t, 3.7) < 1.3
        return (6.0 + (11.0 + 3.0 * square(t, 23.0) if pushes else 0.0),)

    start = rng.normal([6.0, 0.18, 0.12], [0.3, 0.02, 0.02])
    density = [0.5, 4e-5, 2e-5]
    truth = integrate(rates, start, density, physics['seconds'], 0.002, rng, machine)
    return {
        'gauge': sampled(truth, 'gauge', 'gauge', 25.0, column(0), [0.3], rng),
        'flow': sampled(truth, 'flow', 'speed', 25.0, lambda x: [sum(flows(x))], [0.03], rng),
        'belt': sampled(truth, 'belt', 'slide', 10.0, lambda x: [x[1] + x[2]], [0.02], rng),
        'input': commanded(truth, 'pressure', 'number'),
    }


def coldstore(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return six hours of a cold store: its air, its goods, and the coil that cools the air.

    ``coil`` is what it takes from the air in kW/K, ``worn`` the power of the compressor by what
    is recorded, and ``halt`` when the compressor rests for an hour.
    """
    coil, worn, halt = physics['coil'], physics['worn'], physics['halt']

    def rates(x: Vector, u: Vector) -> Vector:
        air, goods, cold = x
        power, outside, opened = u
        inward = (0.12 + 1.2 * opened) * (outside - air)
        given, taken = 0.8 * (goods - air), coil * (air - cold)
        return (
            (given + inward - taken) / 400.0, -given / 6000.0,
            (taken - 2.5 * worn * power) / 150.0,
        )  # fmt: skip

    def plan(t: float, x: Vector) -> Vector:
        runs = math.fmod(t, 2100.0) < 950.0 and not halt <= t < halt + 3600.0
        opened = 1.0 if math.fmod(t + 500.0, 3300.0) < 240.0 else 0.0
        return 2.4 if runs else 0.15, 21.0 + 4.0 * math.sin(t / 5000.0), opened

    start = rng.normal([3.0, 3.5, 0.5], [0.3, 0.2, 0.3])
    density = [4e-5, 1e-7, 4e-5]
    truth = integrate(rates, start, density, physics['seconds'], 1.0, rng, plan, 15.0)

    def suction(x: Array) -> list[Array]:
        return [292800.0 * np.exp(0.034 * x[2])]

    return {
        'air': sampled(truth, 'air', 'temperature', 1 / 15, column(0), [0.15], rng),
        'goods': sampled(truth, 'goods', 'temperature', 1 / 60, column(1), [0.05], rng),
        'suction': sampled(truth, 'suction', 'pressure', 1 / 15, suction, [3000.0], rng),
        'input': commanded(truth, 'plan', 'cooling'),
    }


def softfinger(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a finger of silicone that air bends.

    ``stiffness`` is in 1/s^2, ``leak`` in 1/s; ``least`` is the opening below which the valve
    does nothing, and ``halt`` when the valve is constant for 12 s.
    """
    stiffness, leak = physics['stiffness'], physics['leak']
    least, halt = physics['least'], physics['halt']

    def rates(x: Vector, u: Vector) -> Vector:
        bend, turn, pressure = x
        opened = math.copysign(max(abs(u[0]) - least, 0.0), u[0])
        pull = 1.2 * pressure - stiffness * bend - 4.0 * bend**3 - 5.0 * turn
        return turn, pull, 60.0 * opened - leak * pressure

    def valve(t: float, x: Vector) -> Vector:
        if halt <= t < halt + 12.0:
            t = halt
        return (0.38 + 0.3 * square(t, 3.3) + 0.22 * math.sin(1.9 * t) + 0.1 * square(t, 1.1),)

    start = rng.normal([0.6, 0.0, 28.0], [0.05, 0.2, 2.0])
    density = [0, 0.3, 2.0]
    truth = integrate(rates, start, density, physics['seconds'], 0.002, rng, valve)
    return {
        'flex': sampled(truth, 'flex', 'bend', 50.0, column(0), [0.02], rng),
        'gauge': sampled(truth, 'gauge', 'gauge', 25.0, column(2), [0.6], rng),
        'tip': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, x[1], 0, 0, 0, 0], [0.06] * 6, rng
        ),
        'input': commanded(truth, 'valve', 'number'),
    }


def tumbler(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return four minutes of a small satellite that turns about all axes, with a wheel along z.

    ``inertia`` is that about z in kg m^2, ``friction`` that of the wheel in 1/s, and ``coil_y``
    the torque about y by what is commanded.
    """
    jx, jy, jz, jw = 0.05, 0.06, physics['inertia'], 0.0003
    friction, coil = physics['friction'], physics['coil_y']

    def rates(x: Vector, u: Vector) -> Vector:
        p, q, r, spin = x
        drive = u[3] - friction * jw * spin
        up = jz * r + jw * spin
        return (
            (u[0] - q * up + r * jy * q) / jx, (coil * u[1] - r * jx * p + p * up) / jy,
            (u[2] - p * jy * q + q * jx * p - drive) / jz, drive / jw,
        )  # fmt: skip

    def plan(t: float, x: Vector) -> Vector:
        return (
            0.0012 * square(t, 17.0), 0.0012 * square(t + 6.0, 23.0),
            0.0008 * square(t + 3.0, 29.0),
            0.0006 * square(t + 5.0, 41.0) + 0.0002 * math.sin(0.9 * t),
        )  # fmt: skip

    start = rng.normal([0.05, -0.08, 0.1, 10.0], [0.01, 0.01, 0.01, 2.0])
    bias = rng.normal(0.0, 0.003, 3)
    density = [1e-6, 1e-6, 1e-6, 0.1]
    truth = integrate(rates, start, density, physics['seconds'], 0.02, rng, plan, 0.2)
    return {
        'gyro': sampled(
            truth, 'imu', 'imu', 5.0, lambda x: [*(x[:3].T + bias).T, 0, 0, 0],
            [0.004] * 3 + [0.01] * 3, rng,
        ),
        'stars': sampled(truth, 'stars', 'spins', 1.0, lambda x: [*x[:3]], [0.002] * 3, rng),
        'wheel': sampled(truth, 'wheel', 'wheel', 5.0, column(3), [1.0], rng),
        'input': commanded(truth, 'torques', 'coils_and_wheel'),
    }  # fmt: skip
