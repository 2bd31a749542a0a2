# SPDX-License-Identifier: Apache-2.0
"""A robot's elbow, a hydraulic ram, an orangery, a telescope, and a mixing tank.

Inputs are programs of time.
"""

from __future__ import annotations

import math

import numpy as np

from ..second.vehicles import GRAVITY, Physics
from ..simulation import Array, Readings, Vector, column, commanded, integrate, sampled, square


def elbow(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return half a minute of a forearm that a motor swings through a spring.

    ``mass`` is that of the forearm, ``spring`` the stiffness, and ``play`` the angle to each side
    by which the motor turns before the spring is loaded.
    """
    mass, spring, play = physics['mass'], physics['spring'], physics['play']

    def rates(x: Vector, u: Vector) -> Vector:
        motor, fast, joint, rate = x
        twist = motor - joint
        loaded = math.copysign(max(abs(twist) - play, 0.0), twist)
        torque = spring * loaded + 1.5 * (fast - rate)
        weight = 0.25 * mass * GRAVITY * math.sin(joint)
        return (
            fast, (u[0] - 2.0 * fast - torque) / 0.15,
            rate, (torque - weight - 0.3 * rate) / (0.08 * mass),
        )  # fmt: skip

    def wave(t: float, x: Vector) -> Vector:
        return (7.0 * math.sin(4.4 * t) + 5.0 * square(t, 3.7) + 2.0 * math.sin(11.0 * t),)

    start = rng.normal(0.0, [0.05, 0.1, 0.05, 0.1])
    density = [0, 0.02, 0, 0.02]
    truth = integrate(rates, start, density, physics['seconds'], 0.001, rng, wave, 0.01)
    return {
        'motor': sampled(truth, 'motor', 'angle', 100.0, column(0), [0.004], rng),
        'joint': sampled(truth, 'joint', 'hitch', 50.0, column(2), [0.005], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 100.0, lambda x: [0, x[3], 0, 0, 0, GRAVITY],
            [0.03] * 3 + [0.1] * 3, rng,
        ),
        'input': commanded(truth, 'torque', 'torque'),
    }  # fmt: skip


def ram(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return half a minute of a hydraulic ram with a mass at its rod, behind a valve.

    ``mass`` is that of the load, ``overlap`` the opening by which the valve moves before oil
    flows, and ``back`` the flow backwards by that forwards.
    """
    mass, overlap, back = physics['mass'], physics['overlap'], physics['back']

    def rates(x: Vector, u: Vector) -> Vector:
        opening = math.copysign(max(abs(u[0]) - overlap, 0.0), u[0])
        opening *= back if opening < 0.0 else 1.0
        return (
            x[1], (x[2] - 400.0 * x[1]) / mass, 24000.0 * opening - 80000.0 * x[1] - 5.0 * x[2],
        )  # fmt: skip

    def valve(t: float, x: Vector) -> Vector:
        return (0.5 * square(t, 2.2) + 0.2 * math.sin(7.0 * t) + 0.1 * math.sin(19.0 * t),)

    start = rng.normal([0.6, 0, 0], [0.005, 0.02, 40.0])
    density = [0, 0.0005, 4000.0]
    truth = integrate(rates, start, density, physics['seconds'], 0.001, rng, valve, 0.01)
    return {
        'position': sampled(truth, 'position', 'range', 50.0, column(0), [0.002], rng),
        'pressure': sampled(
            truth, 'pressure', 'pressure', 100.0, lambda x: [x[2] / 0.002], [3e4], rng
        ),
        'rod': sampled(
            truth, 'imu', 'imu', 100.0,
            lambda x: [0, 0, 0, (x[2] - 400.0 * x[1]) / mass, 0, GRAVITY],
            [0.01] * 3 + [0.2] * 3, rng,
        ),
        'input': commanded(truth, 'valve', 'speed'),
    }  # fmt: skip


def orangery(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return ten minutes of the air and the soil in a small orangery.

    ``loss`` is the rate at which the air loses its heat to the outside.
    """
    loss = physics['loss']

    def rates(x: Vector, u: Vector) -> Vector:
        air, soil = x
        warmed = 0.03 * u[0] + 0.02 * u[2]
        return loss * (u[1] - air) + 0.02 * (soil - air) + warmed, 0.004 * (air - soil)

    def climate(t: float, x: Vector) -> Vector:
        clouds = 1.0 + 0.7 * square(t + 40.0, 170.0)
        return 6.0 + 6.0 * square(t, 110.0), 8.0 + 2.0 * math.sin(0.02 * t), 5.0 * clouds

    start = rng.normal([22.0, 18.0], [0.5, 0.5])
    density = [0.002, 0.0001]
    truth = integrate(rates, start, density, physics['seconds'], 0.1, rng, climate, 2.0)
    return {
        'probes': sampled(truth, 'probes', 'probes', 0.5, lambda x: [x[0], x[1]], [0.2, 0.2], rng),
        'leaves': sampled(
            truth, 'leaves', 'temperature', 1.0, lambda x: [0.7 * x[0] + 0.3 * x[1]], [0.3], rng
        ),
        'input': commanded(truth, 'climate', 'climate'),
    }


def telescope(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a telescope that follows satellites, with gyros of unknown bias.

    ``inertia`` is that of the altitude axis, and ``stuck`` the torque that friction takes.
    """
    inertia, stuck = physics['inertia'], physics['stuck']

    def rates(x: Vector, u: Vector) -> Vector:
        first, second = (math.copysign(max(abs(torque) - stuck, 0.0), torque) for torque in u)
        return x[1], (first - 4.0 * x[1]) / 10.0, x[3], (second - 4.0 * x[3]) / inertia

    def slew(t: float, x: Vector) -> Vector:
        return (
            2.0 * square(t, 6.0) + 0.7 * math.sin(2.1 * t),
            1.6 * square(t + 1.0, 7.4) + 0.8 * math.sin(1.7 * t),
        )

    start = rng.normal([0.3, 0, 0.7, 0], [0.02, 0.02, 0.02, 0.02])
    bias = rng.normal(0.0, 0.01, 2)
    density = [0, 2e-5, 0, 2e-5]
    truth = integrate(rates, start, density, physics['seconds'], 0.005, rng, slew, 0.05)

    def gyro(x: Array) -> list[Array | float]:
        return [0, x[3] + bias[1], x[1] + bias[0], 0, 0, GRAVITY]

    return {
        'encoders': sampled(
            truth, 'encoders', 'mount', 20.0, lambda x: [x[0], x[2]], [0.002, 0.002], rng
        ),
        'stars': sampled(truth, 'stars', 'point', 5.0, lambda x: [x[0], x[2]], [5e-4, 5e-4], rng),
        'gyro': sampled(truth, 'imu', 'imu', 50.0, gyro, [0.003] * 3 + [0.05] * 3, rng),
        'input': commanded(truth, 'torques', 'mount_torques'),
    }


def mixer(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return five minutes of a tank in which brine and water are mixed, with an open outlet.

    ``outlet`` is the flow by the root of the level, and ``brine`` the concentration of the feed.
    """
    outlet, brine = physics['outlet'], physics['brine']

    def rates(x: Vector, u: Vector) -> Vector:
        level, salt = x
        return (
            (u[0] + u[1] - outlet * math.sqrt(max(level, 0.0))) / 0.5,
            (u[0] * (brine - salt) - u[1] * salt) / (0.5 * level),
        )

    def pump(t: float, x: Vector) -> Vector:
        return (
            0.008 + 0.004 * square(t, 63.0),
            0.009 + 0.005 * square(t + 9.0, 41.0) + 0.002 * math.sin(0.3 * t),
        )

    start = rng.normal([1.2, 4.5], [0.05, 0.3])
    density = [2e-6, 1e-3]
    truth = integrate(rates, start, density, physics['seconds'], 0.02, rng, pump, 0.5)
    return {
        'level': sampled(truth, 'level', 'range', 4.0, column(0), [0.01], rng),
        'probe': sampled(
            truth, 'conductivity', 'temperature', 2.0, lambda x: [1.7 * x[1]], [0.15], rng
        ),
        'flow': sampled(
            truth, 'outflow', 'speed', 2.0, lambda x: [outlet * np.sqrt(x[0])], [3e-4], rng
        ),
        'input': commanded(truth, 'pumps', 'pumps'),
    }
