# SPDX-License-Identifier: Apache-2.0
"""Plants: a turntable, a shaker, a canal and a reactor; and how a boat rides on its foils.

Inputs are programs of time.
"""

from __future__ import annotations

import math

import numpy as np

from ..second.vehicles import GRAVITY, Physics
from ..simulation import Array, Readings, Vector, column, commanded, integrate, sampled, square


def turntable(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return half a minute of a turntable on a DC motor, with a gyro on it.

    ``inertia`` is with the load, ``resistance`` that of the winding, ``lost`` the voltage that the
    bridge loses, and ``back`` the voltage backwards by that forwards. From ``halt`` on there is no
    voltage for 8 s.
    """
    inertia, resistance = physics['inertia'], physics['resistance']
    lost, back, halt = physics['lost'], physics['back'], physics['halt']

    def rates(x: Vector, u: Vector) -> Vector:
        _, turn, current = x
        volts = math.copysign(max(abs(u[0]) - lost, 0.0), u[0])
        volts *= back if volts < 0.0 else 1.0
        return (
            turn, (0.1 * current - 0.05 * turn) / inertia,
            (volts - 0.1 * turn - resistance * current) / 0.05,
        )  # fmt: skip

    def wave(t: float, x: Vector) -> Vector:
        if halt <= t < halt + 8.0:
            return (0.0,)
        return (4.0 * square(t, 3.4) + 2.0 * math.sin(2.3 * t) + 1.0 * math.sin(9.0 * t),)

    start = rng.normal(0.0, [0.05, 0.3, 0.3])
    density = [0, 0.002, 0.04]
    truth = integrate(rates, start, density, physics['seconds'], 0.001, rng, wave, 0.02)
    return {
        'encoder': sampled(truth, 'encoder', 'angle', 50.0, column(0), [0.01], rng),
        'shunt': sampled(truth, 'current', 'drive_torque', 50.0, column(2), [0.1], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, x[1], 0, 0, GRAVITY],
            [0.03] * 3 + [0.1] * 3, rng,
        ),
        'input': commanded(truth, 'voltage', 'number'),
    }  # fmt: skip


def shaker(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return half a minute of a table on a spring and a damper, which a coil shakes.

    ``mass`` is with the specimen, ``spring`` the stiffness, and ``damper`` in N s/m.
    """
    mass, spring, damper = physics['mass'], physics['spring'], physics['damper']

    def rates(x: Vector, u: Vector) -> Vector:
        return x[1], (u[0] - spring * x[0] - damper * x[1]) / mass

    def push(t: float, x: Vector) -> Vector:
        swept = math.sin((6.0 + 0.5 * t) * t)
        return (60.0 * swept + 40.0 * square(t, 2.6) + 20.0 * math.sin(23.0 * t),)

    start = rng.normal(0.0, [0.003, 0.05])
    truth = integrate(rates, start, [0, 0.02], physics['seconds'], 0.001, rng, push, 0.01)
    return {
        'lvdt': sampled(truth, 'lvdt', 'slide', 100.0, column(0), [5e-4], rng),
        'vibrometer': sampled(truth, 'vibrometer', 'speed', 100.0, column(1), [0.02], rng),
        'cell': sampled(
            truth, 'cell', 'force', 50.0, lambda x: [spring * x[0] + damper * x[1]], [4.0], rng
        ),
        'input': commanded(truth, 'coil', 'force'),
    }


def canal(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return ten minutes of three pools of a small canal, with culverts between them.

    ``culvert`` is the flow through one by the difference of the levels, and ``thief`` a flow out
    of the second pool that nobody records.
    """
    culvert, thief = physics['culvert'], physics['thief']

    def rates(x: Vector, u: Vector) -> Vector:
        first, second = culvert * (x[0] - x[1]), culvert * (x[1] - x[2])
        return (
            (u[0] - first) / 40.0, (first - second - u[1] - thief) / 60.0,
            (second - 0.2 * x[2]) / 50.0,
        )  # fmt: skip

    def gates(t: float, x: Vector) -> Vector:
        return (
            0.3 + 0.12 * square(t, 130.0) + 0.04 * math.sin(0.09 * t),
            0.07 + 0.06 * square(t + 31.0, 94.0),
        )

    start = rng.normal([1.9, 1.35, 1.0], [0.03, 0.03, 0.03])
    density = [2e-6, 2e-6, 2e-6]
    truth = integrate(rates, start, density, physics['seconds'], 0.05, rng, gates, 1.0)
    return {
        'upper': sampled(truth, 'upper', 'range', 1.0, column(0), [0.01], rng),
        'middle': sampled(truth, 'middle', 'range', 1.0, column(1), [0.01], rng),
        'lower': sampled(
            truth, 'lower', 'pressure', 0.5, lambda x: [1000.0 * GRAVITY * x[2]], [80.0], rng
        ),
        'flow': sampled(
            truth, 'flow', 'speed', 1.0, lambda x: [culvert * (x[0] - x[1])], [0.012], rng
        ),
        'input': commanded(truth, 'gates', 'gates'),
    }  # fmt: skip


def reactor(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a quarter of an hour of a stirred reactor with a cooled jacket.

    ``rate`` is that of the reaction at 60 degC, ``transfer`` that of heat through the wall, and
    ``feed_temperature`` that of the feed.
    """
    speed, transfer = physics['rate'], physics['transfer']
    arriving = physics['feed_temperature']

    def rates(x: Vector, u: Vector) -> Vector:
        inside, jacket, feedstock = x
        gone = speed * math.exp(0.05 * (inside - 60.0)) * feedstock
        return (
            u[1] * (arriving - inside) + 15.0 * gone + transfer * (jacket - inside),
            (u[0] - jacket) / 20.0 + 0.5 * transfer * (inside - jacket),
            u[1] * (2.0 - feedstock) - gone,
        )

    def operate(t: float, x: Vector) -> Vector:
        return (
            62.0 + 12.0 * square(t, 210.0) + 3.0 * math.sin(0.05 * t),
            0.011 + 0.005 * square(t + 40.0, 150.0),
        )

    start = rng.normal([52.0, 60.0, 1.2], [0.5, 0.5, 0.05])
    density = [0.002, 0.002, 2e-6]
    truth = integrate(rates, start, density, physics['seconds'], 0.05, rng, operate, 1.0)
    return {
        'thermowell': sampled(truth, 'inside', 'temperature', 1.0, column(0), [0.2], rng),
        'jacket': sampled(truth, 'jacket', 'temperature', 1.0, column(1), [0.2], rng),
        'analyser': sampled(truth, 'analyser', 'speed', 0.5, column(2), [0.03], rng),
        'input': commanded(truth, 'setting', 'jacket_and_feed'),
    }


def hydrofoil(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of the ride of a boat on two foils, whose flaps a program moves.

    ``bow`` is how far the height sensor is ahead of the centre, ``stiff`` the lift by height, and
    ``sea`` the densities of the waves by those of the file.
    """
    bow, stiff, sea = physics['bow'], physics['stiff'], physics['sea']

    def lift(x: Vector | Array) -> Array | float:
        return -stiff * x[0] - 2.5 * x[1] + 16.0 * x[2] + 9.0 * x[4] + 6.0 * x[5]

    def rates(x: Vector, u: Vector) -> Vector:
        _, climb, pitch, turn, fore, aft = x
        return (
            climb, float(lift(x)), turn,
            -0.6 * climb - 7.0 * pitch - 3.0 * turn + 4.0 * fore - 5.0 * aft,
            (u[0] - fore) / 0.15, (u[1] - aft) / 0.15,
        )  # fmt: skip

    def move(t: float, x: Vector) -> Vector:
        return (
            0.08 * square(t, 4.6) + 0.04 * math.sin(1.7 * t),
            0.06 * square(t + 1.0, 6.2) + 0.04 * math.sin(2.9 * t),
        )

    start = rng.normal(0.0, [0.05, 0.1, 0.02, 0.05, 0.01, 0.01])
    density = [0, 0.01 * sea, 0, 0.001 * sea, 1e-6, 1e-6]
    truth = integrate(rates, start, density, physics['seconds'], 0.004, rng, move, 0.04)
    return {
        'bow': sampled(truth, 'bow', 'point', 20.0, lambda x: [x[0] + bow * x[2]], [0.02], rng),
        'attitude': sampled(
            truth, 'ahrs', 'attitude', 25.0, lambda x: [0, x[2], 0], [0, 0.006, 0], rng
        ),
        'imu': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, x[3], 0, 0, 0, lift(x)],
            [0.01] * 3 + [0.15] * 3, rng,
        ),
        'input': commanded(truth, 'flaps', 'flaps'),
    }  # fmt: skip
