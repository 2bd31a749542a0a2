# SPDX-License-Identifier: Apache-2.0
"""Machines: an actuated knee, a hydraulic cylinder, a greenhouse, a wave buoy and a stage.

Inputs are programs of time; the buoy has none.
"""

from __future__ import annotations

import math

import numpy as np

from ..second.vehicles import GRAVITY, Physics
from ..simulation import Array, Readings, Vector, column, commanded, integrate, sampled, square


def knee(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return half a minute of the knee of an exoskeleton, moved by a motor behind a spring.

    ``stiffness`` is that of the spring, and ``weight`` the torque of shank and foot.
    """
    stiffness, weight = physics['stiffness'], physics['weight']

    def rates(x: Vector, u: Vector) -> Vector:
        angle, bending, motor, spin = x
        pull = stiffness * (motor - angle)
        return (
            bending, (pull - weight * math.sin(angle) - 1.5 * bending) / 0.3,
            spin, (u[0] - pull - 2.5 * spin) / 0.15,
        )  # fmt: skip

    def walk(t: float, x: Vector) -> Vector:
        return (5.0 + 5.0 * math.sin(4.3 * t) + 4.0 * square(t, 1.7) + 2.0 * math.sin(13.0 * t),)

    start = rng.normal([0.3, 0, 0.35, 0], [0.02, 0.1, 0.02, 0.1])
    density = [0, 0.1, 0, 0.1]
    truth = integrate(rates, start, density, physics['seconds'], 0.001, rng, walk, 0.01)
    return {
        'joint': sampled(truth, 'joint', 'angle', 100.0, column(0), [0.004], rng),
        'motor': sampled(truth, 'motor', 'angle', 100.0, lambda x: [40.0 * x[2]], [0.1], rng),
        'gauge': sampled(
            truth, 'gauge', 'drive_torque', 100.0, lambda x: [stiffness * (x[2] - x[0])],
            [0.5], rng,
        ),
        'input': commanded(truth, 'motor_torque', 'drive_torque'),
    }  # fmt: skip


def cylinder(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return half a minute of a hydraulic cylinder that moves a load.

    Its input is the speed that the flow through the valve makes. ``mass`` is that of the load in
    kg, ``oil`` the stiffness of the oil in bar/m, ``leak`` in 1/s, and ``overlap`` what the valve
    loses about its middle. The valve rests from 8 s on for ``rest`` seconds.
    """
    mass, oil, leak = physics['mass'], physics['oil'], physics['leak']

    def pull(x: Vector | Array) -> Array | float:
        return (100.0 * x[2] - 4000.0 * x[1]) / mass

    def rates(x: Vector, u: Vector) -> Vector:
        flow = math.copysign(max(abs(u[0]) - physics['overlap'], 0.0), u[0])
        return x[1], float(pull(x)), oil * (flow - x[1]) - leak * x[2]

    def move(t: float, x: Vector) -> Vector:
        if 8.0 <= t < 8.0 + physics['rest']:
            return (0.0,)
        return (0.06 * square(t, 1.7) + 0.05 * math.sin(2.9 * t) + 0.02 * math.sin(23.0 * t),)

    start = rng.normal([0.4, 0, 0], [0.005, 0.02, 2.0])
    truth = integrate(rates, start, [0, 0.0005, 3.0], physics['seconds'], 0.001, rng, move, 0.01)
    return {
        'position': sampled(truth, 'position', 'range', 50.0, column(0), [0.0005], rng),
        'pressure': sampled(
            truth, 'pressure', 'pressure', 100.0, lambda x: [1e5 * x[2]], [5e4], rng
        ),
        'rod': sampled(
            truth, 'rod', 'imu', 100.0, lambda x: [0, 0, 0, pull(x), 0, GRAVITY],
            [0.01] * 3 + [0.15] * 3, rng,
        ),
        'input': commanded(truth, 'valve', 'speed'),
    }  # fmt: skip


def greenhouse(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return an hour of the climate in a greenhouse, by heating, outside air and fog.

    ``glass`` is the rate of the loss through it in 1/s. The door stands open from 1500 s on for
    ``door`` seconds.
    """
    glass = physics['glass']
    clock = [0.0]

    def rates(x: Vector, u: Vector) -> Vector:
        air, floor, moist = x
        draught = 0.003 if 1500.0 <= clock[0] < 1500.0 + physics['door'] else 0.0
        return (
            (glass + draught) * (u[1] - air) + (floor - air) / 900.0 + 0.0012 * u[0]
            - 0.003 * u[2],
            (air - floor) / 3600.0, 0.0005 * u[2] - moist / 1800.0,
        )  # fmt: skip

    def control(t: float, x: Vector) -> Vector:
        clock[0] = t
        heat = 10.0 + 8.0 * square(t, 900.0)
        return heat, 6.0 + 4.0 * math.sin(t / 500.0), 0.5 + 0.5 * square(t, 1300.0)

    start = rng.normal([18.0, 16.0, 0.5], [0.5, 0.5, 0.03])
    density = [4e-5, 2e-6, 2e-8]
    truth = integrate(rates, start, density, physics['seconds'], 0.5, rng, control, 30.0)
    return {
        'air_a': sampled(truth, 'air_a', 'temperature', 0.1, column(0), [0.2], rng),
        'air_b': sampled(truth, 'air_b', 'temperature', 0.1, column(0), [0.3], rng),
        'floor': sampled(truth, 'floor', 'temperature', 0.1, column(1), [0.2], rng),
        'hygrometer': sampled(truth, 'hygrometer', 'humidity', 0.1, column(2), [0.01], rng),
        'input': commanded(truth, 'climate', 'triple'),
    }


def buoy(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of a buoy that heaves and rolls in the sea, on an elastic mooring.

    ``heave`` is the square of the rate of its heave in rad^2/s^2, and ``sea`` the spectral density
    of what drives it.
    """
    heave, sea = physics['heave'], physics['sea']

    def lift(x: Vector | Array) -> Array | float:
        return -heave * x[0] - 0.3 * x[1]

    def rates(x: Vector, u: Vector) -> Vector:
        return x[1], float(lift(x)), x[3], -4.0 * x[2] - 0.4 * x[3] + 0.3 * x[1]

    start = rng.normal([0, 0, 0, 0], [0.4, 0.4, 0.1, 0.2])
    truth = integrate(rates, start, [0, sea, 0, 0.01], physics['seconds'], 0.01, rng)
    return {
        'height': sampled(truth, 'height', 'range', 5.0, column(0), [0.05], rng),
        'motion': sampled(
            truth, 'imu', 'imu', 20.0, lambda x: [x[3], 0, 0, 0, 0, lift(x)],
            [0.02] * 3 + [0.08] * 3, rng,
        ),
        'mooring': sampled(
            truth, 'mooring', 'force', 10.0, lambda x: [1500.0 * x[0] + 200.0 * x[1]], [90.0], rng
        ),
    }  # fmt: skip


def stage(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return half a minute of a table on springs, pushed by two voice coils.

    ``mass`` and ``spring`` are those of the table and along x; a hose pulls along x with ``hose``
    newtons between 12 and 16 s.
    """
    mass, spring = physics['mass'], physics['spring']
    clock = [0.0]

    def rates(x: Vector, u: Vector) -> Vector:
        hose = physics['hose'] if 12.0 <= clock[0] < 16.0 else 0.0
        return (
            x[1], (u[0] + hose - spring * x[0] - 25.0 * x[1]) / mass,
            x[3], (u[1] - 500.0 * x[2] - 18.0 * x[3]) / mass,
        )  # fmt: skip

    def push(t: float, x: Vector) -> Vector:
        clock[0] = t
        return 12.0 * square(t, 2.3) + 6.0 * math.sin(9.0 * t), 8.0 * square(
            t, 3.1
        ) + 4.0 * math.sin(5.0 * t)

    start = rng.normal([0, 0, 0, 0], [0.003, 0.02, 0.003, 0.02])
    power = 0.2 / mass**2
    truth = integrate(
        rates, start, [0, power, 0, power], physics['seconds'], 0.002, rng, push, 0.01
    )
    return {
        'lasers': sampled(
            truth, 'lasers', 'point', 50.0, lambda x: [x[0], x[2]], [0.0003, 0.0003], rng
        ),
        'geophones': sampled(
            truth, 'geophones', 'planar', 100.0, lambda x: [x[1], x[3]], [0.004, 0.004], rng
        ),
        'input': commanded(truth, 'coils', 'push'),
    }
