# SPDX-License-Identifier: Apache-2.0
"""What stays in its place: a spring, a pendulum, a motor, an elevator, two tanks, an oven."""

from __future__ import annotations

import math

import numpy as np

from .simulation import Array, Readings, Vector, column, commanded, integrate, sampled, square
from .vehicles import GRAVITY


def spring(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return a minute and a half of a mass on a spring that a hand pushes at random.

    The push is not measured: it decays in 1.5 s. The accelerometer is on the mass.
    """
    mass, stiffness, damping = physics['mass'], 20.0, 0.8

    def rates(x: Vector, u: Vector) -> Vector:
        return x[1], (x[2] - stiffness * x[0] - damping * x[1]) / mass, -x[2] / 1.5

    def imu(x: Array) -> list[Array | float]:
        return [0, 0, 0, (x[2] - stiffness * x[0] - damping * x[1]) / mass, 0, GRAVITY]

    start = rng.normal(0.0, [0.1, 0.3, 1.0])
    truth = integrate(rates, start, [0, 0, 2.0], 90.0, 0.002, rng)
    return {
        'position': sampled(truth, 'place', 'point', 20.0, column(0), [0.01], rng),
        'accelerometer': sampled(
            truth, 'imu', 'imu', 100.0, imu, [0.01] * 3 + [0.05] * 3, rng
        ),
    }  # fmt: skip


def pendulum(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return a minute of a pendulum of 0.5 m that a torque swings by up to a radian and more."""
    length, mass, damping = physics['length'], 1.0, physics['damping']

    def rates(x: Vector, u: Vector) -> Vector:
        pull = GRAVITY / length * math.sin(x[0])
        return x[1], u[0] / (mass * length**2) - pull - damping * x[1]

    def push(t: float, x: Vector) -> Vector:
        return (1.2 * math.sin(3.6 * t) * math.sin(0.2 * t) + 0.8 * square(t, 7.0),)

    start = rng.normal(0.0, [0.2, 0.3])
    truth = integrate(rates, start, [0, 0.05], 60.0, 0.002, rng, push)
    return {
        'encoder': sampled(truth, 'joint_states', 'angle', 50.0, column(0), [0.01], rng),
        'gyro': sampled(
            truth, 'imu', 'imu', 100.0, lambda x: [0, x[1], 0, 0, 0, 0], [0.05] * 6, rng
        ),
        'input': commanded(truth, 'torque', 'torque'),
    }


def motor(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return a minute of a motor whose voltage, without stamps, changes sign often."""
    inertia, friction, constant, resistance, inductance = 0.002, 0.004, 0.08, 1.5, 0.15

    def rates(x: Vector, u: Vector) -> Vector:
        _, omega, i = x
        return (
            omega,
            (constant * i - friction * omega) / inertia,
            (u[0] - constant * omega - resistance * i) / inductance,
        )

    def voltage(t: float, x: Vector) -> Vector:
        return (1.2 * math.sin(0.8 * t) + 0.5 * square(t, 3.0),)

    start = rng.normal(0.0, [0.1, 0.3, 0.1])
    density = [0, 2e-5 / inertia**2, 1e-3 / inductance**2]
    truth = integrate(rates, start, density, 60.0, 0.002, rng, voltage)
    return {
        'encoder': sampled(truth, 'encoder', 'angle', 50.0, column(0), [0.02], rng),
        'tachometer': sampled(truth, 'tacho', 'turning', 50.0, column(1), [0.2], rng),
        'input': commanded(truth, 'voltage', 'numbers'),
    }


def elevator(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return two minutes of an elevator that stops at floors between 0 and 30 m."""
    floors = (6.0, 21.0, 3.0, 30.0, 12.0, 0.0)

    def rates(x: Vector, u: Vector) -> Vector:
        return x[1], x[2], (u[0] - x[2]) / 0.3

    def lift(t: float, x: Vector) -> Vector:
        target = floors[int(t / 20.0) % len(floors)]
        speed = max(-2.5, min(2.5, 0.6 * (target - x[0])))
        return (max(-1.0, min(1.0, 1.5 * (speed - x[1]))),)

    def pressure(x: Array) -> list[Array]:
        return [101325.0 * (1.0 - 0.0065 / 288.15 * (x[0] + 400.0)) ** 5.255876]

    start = rng.normal(0.0, [0.5, 0.1, 0.05])
    truth = integrate(rates, start, [0, 0, 0.02], 120.0, 0.002, rng, lift, 0.05)
    return {
        'barometer': sampled(truth, 'pressure', 'pressure', 20.0, pressure, [6.0], rng),
        'accelerometer': sampled(
            truth, 'imu', 'imu', 100.0, lambda x: [0, 0, 0, 0, 0, x[2]], [0.05] * 6, rng
        ),
        'input': commanded(truth, 'lift', 'lift'),
    }


def tank(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return ten minutes of two tanks in a row, of 0.4 m^2 each, filled by a pump.

    The pump, measured without stamps, changes every 40 s; the valve may be another than known.
    """
    valve, area = physics['valve'], 0.4

    def rates(x: Vector, u: Vector) -> Vector:
        over = 0.01 * (x[0] - x[1])
        return (u[0] - over) / area, (over - valve * x[1]) / area

    def pump(t: float, x: Vector) -> Vector:
        return (0.006 + 0.004 * square(t, 80.0) + 0.002 * math.sin(0.03 * t),)

    start = rng.normal([1.3, 0.7], [0.1, 0.1])
    truth = integrate(rates, start, [4e-6, 4e-6], 600.0, 0.05, rng, pump, 0.5)
    return {
        'upper': sampled(truth, 'upper', 'range', 2.0, column(0), [0.01], rng),
        'lower': sampled(truth, 'lower', 'range', 2.0, column(1), [0.01], rng),
        'input': commanded(truth, 'inflow', 'number'),
    }


def oven(rng: np.random.Generator, physics: dict[str, float]) -> Readings:
    """Return half an hour of an oven: a core in a wall in a room, heated for 2 of 5 minutes."""

    def rates(x: Vector, u: Vector) -> Vector:
        inward, outward = 8.0 * (x[0] - x[1]), 4.0 * (x[1] - x[2])
        return (u[0] - inward) / 800.0, (inward - outward) / 3000.0, 0.0

    def heat(t: float, x: Vector) -> Vector:
        return (600.0 if math.fmod(t, 300.0) < 120.0 else 50.0,)

    start = rng.normal([20.0, 20.0, 20.0], [2.0, 2.0, 2.0])
    truth = integrate(rates, start, [0.01, 0.001, 1e-5], 1800.0, 0.25, rng, heat, 1.0)
    noise = {'core': 0.5, 'wall': 0.3, 'room': 0.2}
    return {
        **{
            name: sampled(truth, name, 'temperature', 1.0, column(k), [noise[name]], rng)
            for k, name in enumerate(noise)
        },
        'input': commanded(truth, 'heater', 'heater'),
    }
