# SPDX-License-Identifier: Apache-2.0
"""Machines: an arm of two links, a balancer, a suspension, a copter's height and a boat in view.

Their inputs follow schedules, or what a controller sees with errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..second.vehicles import GRAVITY, Physics
from ..simulation import (
    Array,
    Channel,
    Readings,
    Vector,
    column,
    commanded,
    integrate,
    sampled,
    square,
)


def manipulator(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of an arm of two links of 0.5 m in a vertical plane, with a gyro at its end.

    Angles are from hanging, the second one from the first link.
    """
    tool, friction = physics['mass_2'], physics['friction']
    b, d = tool * 0.5 * 0.2, 0.1 + tool * 0.2**2
    a = 0.3 + 3.0 * 0.25**2 + tool * 0.5**2 + d

    def weights(q1: float, q2: float, mass: float) -> tuple[float, float]:
        outer = mass * 0.2 * GRAVITY * math.sin(q1 + q2)
        return (3.0 * 0.25 + mass * 0.5) * GRAVITY * math.sin(q1) + outer, outer

    def rates(x: Vector, u: Vector) -> Vector:
        q1, w1, q2, w2 = x
        m11, m12, bend = a + 2.0 * b * math.cos(q2), d + b * math.cos(q2), b * math.sin(q2)
        weight = weights(q1, q2, tool)
        f1 = u[0] - friction * w1 - weight[0] + bend * w2 * (2.0 * w1 + w2)
        f2 = u[1] - friction * w2 - weight[1] - bend * w1**2
        scale = m11 * d - m12**2
        return w1, (d * f1 - m12 * f2) / scale, w2, (m11 * f2 - m12 * f1) / scale

    def hold(t: float, x: Vector) -> Vector:
        q1, w1, q2, w2 = x + rng.normal(0.0, [0.03, 0.2] * 2)
        wish = 0.7 + 0.4 * square(t, 9.0), 0.6 * math.sin(0.9 * t) + 0.2 * square(t + 2.0, 7.0)
        first, second = weights(q1, q2, 2.0)
        return first + 20.0 * (wish[0] - q1) - 5.0 * w1, second + 6.0 * (wish[1] - q2) - 1.5 * w2

    start = rng.normal([0.5, 0, 0, 0], [0.05, 0.1, 0.05, 0.1])
    density = [0, 0.02, 0, 0.05]
    truth = integrate(rates, start, density, physics['seconds'], 0.004, rng, hold, 0.02)
    return {
        'encoders': sampled(
            truth, 'joint_states', 'arm', 25.0, lambda x: [x[0], x[2]], [0.003] * 2, rng
        ),
        'gyro': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, x[1] + x[3], 0, 0, 0, 0], [0.02] * 6, rng
        ),
        'input': commanded(truth, 'efforts', 'arm_torques'),
    }


def balancer(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of a robot that balances on two wheels and drives back and forth.

    A body of 3 kg with its centre at ``height`` is on wheels of 0.08 m. Torques below ``stuck``
    do nothing, and those that drive forwards act by ``ahead``. The controller sees the recorded
    readings and nothing else: what it knew beyond them would show in the torque.
    """
    height, stuck, ahead = physics['height'], physics['stuck'], physics['ahead']
    arm, inertia = 3.0 * height, 0.06 + 3.0 * height**2

    def rates(x: Vector, u: Vector) -> Vector:
        _, v, tilt, rate = x
        acting = math.copysign(max(abs(u[0]) - stuck, 0.0), u[0]) * (ahead if u[0] > 0 else 1.0)
        torque = acting - 0.03 * (v / 0.08 - rate)
        couple = arm * math.cos(tilt)
        push = torque / 0.08 + arm * math.sin(tilt) * rate**2
        fall = arm * GRAVITY * math.sin(tilt) - torque
        scale = 4.2 * inertia - couple**2
        return (
            v, (inertia * push - couple * fall) / scale, rate, (4.2 * fall - couple * push) / scale
        )  # fmt: skip

    errors = list[Array]()
    belief = [0.0, 0.0, 0.0]  # of the controller: tilt, way and speed

    def balance(t: float, x: Vector) -> Vector:
        errors.append(rng.normal(0.0, [0.02, 0.03, 0.02]))
        angle, rate, seen = (x[0] / 0.08 - x[2], x[3], x[2]) + errors[-1]
        tilt = 0.95 * (belief[0] + 0.02 * rate) + 0.05 * seen
        way = 0.08 * (angle + tilt)
        v = belief[2] + 0.3 * ((way - belief[1]) / 0.02 - belief[2])
        belief[:] = tilt, way, v
        wish = 0.5 * square(t, 13.0) + 0.2 * math.sin(0.8 * t)
        return (max(-2.5, min(2.5, way - wish + 1.72 * v + 7.07 * tilt + 1.09 * rate)),)

    start = rng.normal([0, 0, 0, 0], [0.01, 0.05, 0.03, 0.05])
    density = [0, 0.01, 0, 0.05]
    truth = integrate(rates, start, density, physics['seconds'], 0.002, rng, balance, 0.02)

    def read(topic: str, form: str, value: Array, k: int, width: int, place: int) -> Channel:
        channel = commanded(truth, topic, form)
        channel.value, channel.noise = np.zeros((2, len(value), width))
        channel.value[:, place], channel.noise[:, place] = value, np.array(errors)[:, k]
        channel.received -= 3e-4  # before the torque that it leads to
        channel.sensor = True
        return channel

    state = truth.state[:-1:10]
    return {
        'wheel': read('wheel', 'angle', state[:, 0] / 0.08 - state[:, 2], 0, 1, 0),
        'gyro': read('imu', 'imu', state[:, 3], 1, 6, 1),
        'tilt': read('tilt', 'attitude', state[:, 2], 2, 3, 1),
        'input': commanded(truth, 'torque', 'drive_torque'),
    }


def suspension(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return forty seconds of a quarter of a car on a test track, whose damper has an actuator.

    A body of 250 kg is on a wheel of 40 kg; the velocity of the road is white noise.
    """
    damping, road, gain = physics['damping'], physics['road'], physics['gain']

    def push(x: Vector) -> tuple[float, float]:
        travel, body, tyre, wheel, force = x
        strut = 16000.0 * travel + damping * (body - wheel) - force
        return -strut / 250.0, (strut - 120000.0 * tyre) / 40.0

    def rates(x: Vector, u: Vector) -> Vector:
        body, wheel = push(x)
        return x[1] - x[3], body, x[3], wheel, 25.0 * (gain * u[0] - x[4])

    def shake(t: float, x: Vector) -> Vector:
        return (250.0 * square(t, 5.0) + 150.0 * math.sin(4.0 * t),)

    def accelerometer(k: int) -> Callable[[Array], list[Array | float]]:
        return lambda x: [0, 0, 0, 0, 0, np.array([push(row)[k] for row in x.T.tolist()])]

    start = rng.normal(0.0, [0.005, 0.05, 0.001, 0.05, 10])
    density = [0, 0.01, road, 0, 0]
    truth = integrate(rates, start, density, physics['seconds'], 0.001, rng, shake, 0.02)
    return {
        'travel': sampled(truth, 'travel', 'range', 50.0, column(0), [0.001], rng),
        'body': sampled(truth, 'body', 'imu', 100.0, accelerometer(0), [0.15] * 6, rng),
        'hub': sampled(truth, 'hub', 'imu', 100.0, accelerometer(1), [3.0] * 6, rng),
        'input': commanded(truth, 'actuator', 'force'),
    }


def altitude(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of the height of a copter, whose accelerometer is the input.

    The driver removes gravity; the bias wanders slowly.
    """

    def fly(t: float, x: Vector) -> Vector:
        wave = 0.31 * math.cos(0.35 * (t + 0.01)) + 0.97 * math.cos(1.1 * (t + 0.01))
        return (wave + 0.4 * square(t + 1.5, 6.0),)

    def pressure(x: Array) -> list[Array]:
        return [101325.0 * (1.0 - 0.0065 / 288.15 * (x[0] + 250.0)) ** 5.255876]

    start = rng.normal([5.0, 0.0], [0.3, 0.02])
    truth = integrate(
        lambda x, u: (x[1], u[0]), start, [0, 0], physics['seconds'], 0.005, rng, fly, 0.02
    )
    steps = rng.normal(0.0, math.sqrt(1e-6 * 0.02), truth.command.shape)
    steps[0] = rng.normal(0.0, 0.1)
    truth.command += np.cumsum(steps, axis=0)
    heard = commanded(truth, 'acceleration', 'lift')
    heard.noise = rng.normal(0.0, math.sqrt(0.002 / 0.02), truth.command.shape)
    return {
        'barometer': sampled(truth, 'pressure', 'pressure', 10.0, pressure, [5.0], rng),
        'laser': sampled(truth, 'laser', 'range', 20.0, column(0), [0.04], rng),
        'input': heard,
    }


def vessel(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two minutes of a boat before a harbour that two cameras on the shore see.

    The cameras are at (0, 0) and (``camera``, 0), and the boat sends its place by radio.
    """

    def bearing(px: float) -> Callable[[Array], list[Array]]:
        return lambda x: [np.arctan2(x[1], x[0] - px)]

    start = rng.normal([150.0, 320.0, 2.5, -0.5], [5.0, 5.0, 0.5, 0.5])
    density = [0, 0, 0.03, 0.03]
    truth = integrate(
        lambda x, u: (x[2], x[3], 0, 0), start, density, physics['seconds'], 0.01, rng
    )
    return {
        'west': sampled(truth, 'west', 'point', 5.0, bearing(0.0), [0.004], rng),
        'east': sampled(truth, 'east', 'point', 4.0, bearing(physics['camera']), [0.004], rng),
        'ais': sampled(truth, 'ais', 'point', 1.0, lambda x: [x[0], x[1]], [3.0, 3.0], rng),
    }
