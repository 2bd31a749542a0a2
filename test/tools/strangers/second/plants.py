# SPDX-License-Identifier: Apache-2.0
"""Plants and machines: a crane, a hoist, a chamber, tanks, a rod, a satellite and an arm.

The controllers see noisy measurements or follow a schedule, and never see the true state.
"""

from __future__ import annotations

import math

import numpy as np

from ..simulation import Array, Readings, Vector, column, commanded, integrate, sampled, square
from .vehicles import GRAVITY, Physics


def crane(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two minutes of a crane, driven by a schedule of speeds."""
    length = physics['length']

    def rates(x: Vector, u: Vector) -> Vector:
        _, v, swing, rate = x
        a = (u[0] - v) / 0.5
        turn = -(GRAVITY * math.sin(swing) + a * math.cos(swing)) / length
        return v, a, rate, turn - 0.05 * rate

    def drive(t: float, x: Vector) -> Vector:
        return (0.7 * square(t, 14.0) + 0.4 * math.sin(0.9 * t) - 0.1,)

    start = rng.normal([0.0, 0.0, 0.0, 0.0], [0.3, 0.1, 0.05, 0.05])
    density = [0, 0.002, 0, 0.0002]
    truth = integrate(rates, start, density, physics['seconds'], 0.01, rng, drive, 0.1)
    return {
        'trolley': sampled(truth, 'trolley', 'trolley', 20.0, column(0), [0.005], rng),
        'swing': sampled(truth, 'swing', 'angle', 10.0, column(2), [0.004], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, x[3], 0, 0, 0, 0], [0.005] * 6, rng
        ),
        'input': commanded(truth, 'speed', 'speed'),
    }


def hoist(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of a cabin on an elastic rope, with an encoder at each end.

    A drum of 0.3 m and 6 kg m^2 pulls 300 kg, balanced by a counterweight. The controller sees
    the height within 0.05 m, and the speed within 0.05 m/s.
    """
    friction = physics['friction']
    floors = (4.0, 16.0, 10.0, 22.0, 1.0)

    def rates(x: Vector, u: Vector) -> Vector:
        theta, omega, z, v = x
        pull = 30000.0 * (0.3 * theta - z) + 900.0 * (0.3 * omega - v)
        return omega, (u[0] - friction * omega - 0.3 * pull) / 6.0, v, pull / 300.0

    def lift(t: float, x: Vector) -> Vector:
        target = floors[int(t / 15.0) % len(floors)]
        z, v = x[2] + rng.normal(0.0, 0.05), x[3] + rng.normal(0.0, 0.05)
        speed = max(-2.5, min(2.5, 0.7 * (target - z)))
        return (max(-250.0, min(250.0, 250.0 * (speed - v))),)

    z = rng.normal(0.0, 0.3)
    start = rng.normal([z / 0.3, 0.0, z, 0.0], [0.01, 0.1, 0.003, 0.03])
    density = [0, 0.02, 0, 0.001]
    truth = integrate(rates, start, density, physics['seconds'], 0.004, rng, lift, 0.1)
    return {
        'drum': sampled(truth, 'drum', 'angle', 25.0, column(0), [0.02], rng),
        'tape': sampled(truth, 'tape', 'point', 25.0, column(2), [0.01], rng),
        'input': commanded(truth, 'torque', 'drive_torque'),
    }


def chamber(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return forty minutes of a thermal chamber that heats and cools a sample.

    Inputs are the power and the temperature outside. ``cooling`` is the effect of cooling by its
    declared effect.
    """
    cooling = physics['cooling']

    def rates(x: Vector, u: Vector) -> Vector:
        air, sample, wall = x
        power = u[0] if u[0] > 0.0 else cooling * u[0]
        inward, outward = 15.0 * (air - sample), 20.0 * (air - wall)
        return (
            (power - inward - outward) / 2000.0,
            inward / 5000.0,
            (outward - 10.0 * (wall - u[1])) / 8000.0,
        )

    def heat(t: float, x: Vector) -> Vector:
        power = 700.0 * square(t, 700.0) + 250.0 * math.sin(0.03 * t)
        return power, 20.0 + 3.0 * math.sin(0.001 * t)

    start = rng.normal([20.0, 20.0, 20.0], [1.0, 1.0, 1.0])
    density = [0.002, 0.0002, 0.0002]
    truth = integrate(rates, start, density, physics['seconds'], 0.25, rng, heat, 5.0)
    return {
        'air': sampled(truth, 'air', 'temperature', 1.0, column(0), [0.2], rng),
        'sample': sampled(truth, 'sample', 'temperature', 0.5, column(1), [0.1], rng),
        'wall': sampled(truth, 'wall', 'temperature', 0.2, column(2), [0.15], rng),
        'input': commanded(truth, 'power', 'numbers'),
    }


def chain(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return ten minutes of three open tanks in series, with a pump that follows a schedule."""
    area, outlet = physics['area'], physics['outlet']

    def rates(x: Vector, u: Vector) -> Vector:
        flow = [outlet * math.sqrt(2.0 * GRAVITY * max(h, 1e-3)) for h in x]
        return (u[0] - flow[0]) / area, (flow[0] - flow[1]) / area, (flow[1] - flow[2]) / area

    def pump(t: float, x: Vector) -> Vector:
        return (0.0036 + 0.0009 * square(t, 90.0) + 0.0004 * math.sin(0.11 * t),)

    start = rng.normal([1.0, 1.0, 1.0], [0.1, 0.1, 0.1])
    truth = integrate(
        rates, start, [4e-6, 4e-6, 4e-6], physics['seconds'], 0.05, rng, pump, 0.5
    )  # fmt: skip
    return {
        'top': sampled(truth, 'top', 'range', 2.0, column(0), [0.01], rng),
        'middle': sampled(
            truth, 'middle', 'pressure', 2.0, lambda x: [1000.0 * GRAVITY * x[1]], [80.0], rng
        ),
        'flow': sampled(
            truth, 'flow', 'point', 1.0,
            lambda x: [1000.0 * outlet * np.sqrt(2.0 * GRAVITY * x[2])], [0.03], rng,
        ),
        'input': commanded(truth, 'inflow', 'number'),
    }  # fmt: skip


def rod(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a pendulum of 0.8 m with an IMU on its rod, and a slow camera.

    The axes of the IMU are along the rod, towards the pivot (z), and along the swing (x).
    """
    radius, damping = physics['radius'], physics['damping']

    def turn(x: Vector, u: Vector) -> float:
        pull = GRAVITY / 0.8 * math.sin(x[0])
        return u[0] / (0.5 * 0.8**2) - pull - damping * x[1]

    def rates(x: Vector, u: Vector) -> Vector:
        return x[1], turn(x, u)

    def push(t: float, x: Vector) -> Vector:
        return (0.5 * math.sin(3.0 * t) * math.sin(0.15 * t) + 0.5 * square(t, 9.0),)

    def imu(x: Array) -> list[Array | float]:
        gravity = GRAVITY * np.sin(x[0])
        along = gravity - radius * (GRAVITY / 0.8 * np.sin(x[0]) + damping * x[1])
        return [0, x[1], 0, along, 0, radius * x[1] ** 2 + GRAVITY * np.cos(x[0])]

    start = rng.normal([physics['start'], 0.0], [0.2, 0.3])
    truth = integrate(rates, start, [0, 0.02], physics['seconds'], 0.004, rng, push, 0.02)
    return {
        'imu': sampled(truth, 'imu', 'imu', 50.0, imu, [0.03] * 3 + [0.15] * 3, rng),
        'camera': sampled(truth, 'camera', 'angle', 10.0, column(0), [0.02], rng),
        'input': commanded(truth, 'torque', 'torque'),
    }


def satellite(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return five minutes of a satellite about one axis, turned by a wheel to a schedule.

    Its gyroscope has a constant bias, which the file declares by its standard deviation.
    """
    inertia = physics['inertia']

    def rates(x: Vector, u: Vector) -> Vector:
        return x[1], u[0] / inertia

    def wheel(t: float, x: Vector) -> Vector:
        return (0.03 * square(t + 12.0, 48.0) + 0.01 * math.sin(0.2 * t),)

    start = rng.normal([physics['start'], 0.0], [0.02, 0.005])
    bias = rng.normal(0.0, 0.004)
    truth = integrate(rates, start, [0, 1e-8], physics['seconds'], 0.02, rng, wheel, 0.2)
    return {
        'star': sampled(truth, 'star', 'compass', 2.0, column(0), [0.001], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 10.0, lambda x: [0, 0, x[1] + bias, 0, 0, 0], [0.0005] * 6, rng
        ),
        'input': commanded(truth, 'wheel', 'spin'),
    }


def arm(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a joint that lifts a tool of 4 kg at 0.3 m, by feedback.

    Its controller sees angle and rate with errors of 0.01 rad and 0.05 rad/s. Up to ``stiction``
    a torque has no effect, and above it the excess has.
    """
    mass, friction, stiction = physics['mass'], physics['friction'], physics['stiction']
    weight, inertia = mass * GRAVITY * 0.3, 0.2 + mass * 0.3**2

    def rates(x: Vector, u: Vector) -> Vector:
        torque = math.copysign(max(abs(u[0]) - stiction, 0.0), u[0])
        return x[1], (torque - weight * math.sin(x[0]) - friction * x[1]) / inertia

    def hold(t: float, x: Vector) -> Vector:
        angle, rate = x[0] + rng.normal(0.0, 0.01), x[1] + rng.normal(0.0, 0.05)
        wanted = 0.7 * math.sin(0.7 * t) + 0.5 * square(t, 11.0)
        return (11.77 * math.sin(angle) + 9.0 * (wanted - angle) - 2.0 * rate,)

    start = rng.normal([0.0, 0.0], [0.05, 0.1])
    truth = integrate(rates, start, [0, 0.05], physics['seconds'], 0.004, rng, hold, 0.02)
    return {
        'encoder': sampled(truth, 'joint', 'angle', 50.0, column(0), [0.005], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 25.0, lambda x: [0, 0, x[1], 0, 0, 0], [0.03] * 6, rng
        ),
        'input': commanded(truth, 'effort', 'drive_torque'),
    }
