# SPDX-License-Identifier: Apache-2.0
"""A tracked headset, and machines: a gantry, a silo, a wind turbine and a ball on a plate.

Inputs are programs of time, the readings of an IMU, or what a controller makes of the readings.
"""

from __future__ import annotations

import math

import numpy as np

from ..second.vehicles import GRAVITY, Physics
from ..simulation import (
    Array,
    Channel,
    Readings,
    Track,
    Vector,
    column,
    commanded,
    integrate,
    sampled,
    square,
)
from .rotations import Quaternion, exponential, logarithm, product, rotated

#: Amplitudes in m, and rates in rad/s, of the two sines of each coordinate of the headset.
_SWAY = (((0.5, 1.1), (0.1, 3.3)), ((0.4, 0.9), (0.1, 2.9)), ((0.15, 1.6), (0.05, 4.1)))


def headset(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return seconds of a headset whose pose a camera in the room measures by markers on it.

    The readings of its IMU are the input, and means over 10 ms. ``markers`` is how far they are
    ahead of the IMU, and ``turned`` how far about the vertical, in rad.
    """
    step, count = 0.0025, round(physics['seconds'] / 0.0025)
    time: Array = step * np.arange(count + 1, dtype=np.float64)
    q: Quaternion = exponential(rng.normal([0.1, -0.1, 0.8], 0.05).tolist())
    attitudes, rates, forces = list[Quaternion](), list[list[float]](), list[list[float]]()
    for t in time.tolist():
        pull = [-sum(a * w**2 * math.sin(w * t) for a, w in sines) for sines in _SWAY]
        back = q[0], -q[1], -q[2], -q[3]
        forces.append(rotated(back, [pull[0], pull[1], pull[2] + GRAVITY]))
        rates.append([math.sin(1.7 * t), 0.8 * math.cos(1.3 * t), 0.9 * math.sin(0.8 * t)])
        attitudes.append(q)
        middle = t + 0.5 * step
        turn = math.sin(1.7 * middle), 0.8 * math.cos(1.3 * middle), 0.9 * math.sin(0.8 * middle)
        q = product(q, exponential([step * w for w in turn]))
    place = np.array([[a * np.sin(w * time) for a, w in sines] for sines in _SWAY]).sum(axis=1).T
    ahead = [rotated(attitude, (physics['markers'], 0.0, 0.0)) for attitude in attitudes]
    markers = exponential((0.0, 0.0, physics['turned']))
    turned = [logarithm(product(attitude, markers)) for attitude in attitudes]
    pose: Array = np.hstack((place + ahead, turned))

    sensed = np.hstack((rates, forces))
    parts = [sensed[k : count - 4 + k + 1 : 4] for k in range(5)]
    imu: Array = np.tensordot([0.125, 0.25, 0.25, 0.25, 0.125], parts, 1)
    start, growth = np.repeat([0.005, 0.05], 3), np.repeat([1e-9, 1e-7], 3)
    walk = rng.standard_normal(imu.shape) * np.sqrt(0.01 * growth)
    walk[0] = rng.normal(0.0, start)
    truth = Track(time, pose, time[:-4:4], imu + np.cumsum(walk, axis=0))
    received = commanded(truth, 'imu', 'imu')
    received.noise = rng.standard_normal(imu.shape) * np.sqrt(np.repeat([1e-6, 1e-4], 3) / 0.01)
    return {
        'camera': sampled(
            truth, 'pose', 'pose', 20.0, lambda x: [*x, 0, 0, 0],
            [0.004] * 3 + [0] * 3 + [0.008] * 3, rng,
        ),
        'input': received,
    }  # fmt: skip


def gantry(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return half a minute of a gantry: a motor of 2 kg moves a carriage by an elastic belt.

    ``stuck`` is the force that the motor loses to friction.
    """
    mass, belt, stuck = physics['mass'], physics['belt'], physics['stuck']

    def pull(x: Vector | Array) -> Array | float:
        return belt * (x[0] - x[2]) + 12.0 * (x[1] - x[3])

    def rates(x: Vector, u: Vector) -> Vector:
        acting = math.copysign(max(abs(u[0]) - stuck, 0.0), u[0])
        force = float(pull(x))
        return x[1], (acting - 25.0 * x[1] - force) / 2.0, x[3], force / mass

    def move(t: float, x: Vector) -> Vector:
        return (22.0 * square(t, 2.6) + 8.0 * math.sin(9.0 * t) + 4.0 * math.sin(31.0 * t),)

    start = rng.normal(0.0, [0.002, 0.02, 0.002, 0.02])
    truth = integrate(rates, start, [0, 0.02, 0, 0.01], physics['seconds'], 0.001, rng, move, 0.01)
    return {
        'encoder': sampled(truth, 'motor', 'angle', 100.0, lambda x: [x[0] / 0.02], [0.02], rng),
        'laser': sampled(truth, 'laser', 'range', 50.0, column(2), [0.001], rng),
        'imu': sampled(
            truth, 'imu', 'imu', 100.0, lambda x: [0, 0, 0, pull(x) / mass, 0, GRAVITY],
            [0.01] * 3 + [0.15] * 3, rng,
        ),
        'input': commanded(truth, 'force', 'force'),
    }  # fmt: skip


def silo(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return five minutes of the level in a silo, which changes as a random walk."""
    start = rng.normal([6.0], [0.2])
    truth = integrate(lambda x, u: (0.0,), start, [0.002], physics['seconds'], 0.025, rng)
    return {
        'radar': sampled(truth, 'radar', 'range', 2.0, column(0), [0.03], rng),
        'ultrasound': sampled(truth, 'ultrasound', 'range', 4.0, column(0), [0.05], rng),
        'cells': sampled(truth, 'cells', 'force', 1.0, lambda x: [4e3 * x[0]], [160.0], rng),
    }


def turbine(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two minutes of a small wind turbine with an elastic shaft in a varying wind.

    ``inertia`` and ``shaft`` are those of the rotor and of the stiffness behind it.
    """
    inertia, shaft = physics['inertia'], physics['shaft']

    def rates(x: Vector, u: Vector) -> Vector:
        rotor, twist, generator, wind = x
        torque = shaft * twist + 80.0 * (rotor - generator)
        wheel = 10.5 * wind**2 - 3.7 * wind * rotor
        return (
            (wheel - torque) / inertia, rotor - generator, (torque - u[0]) / 60.0,
            (9.0 - wind) / 20.0,
        )  # fmt: skip

    def load(t: float, x: Vector) -> Vector:
        return (450.0 + 120.0 * square(t, 9.0) + 60.0 * math.sin(2.3 * t),)

    start = rng.normal([12.0, 0.055, 12.0, 9.0], [0.3, 0.01, 0.3, 0.5])
    density = [0.002, 0, 0.002, 0.06]
    truth = integrate(rates, start, density, physics['seconds'], 0.004, rng, load, 0.1)
    return {
        'rotor': sampled(truth, 'rotor', 'wheel', 10.0, column(0), [0.05], rng),
        'generator': sampled(
            truth, 'generator', 'turning', 25.0, lambda x: [12.0 * x[2]], [0.6], rng
        ),
        'anemometer': sampled(truth, 'wind', 'speed', 5.0, column(3), [0.4], rng),
        'input': commanded(truth, 'torque', 'force'),
    }


def plate(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return minutes of a ball on a plate, which two servos tilt and a camera sees from above.

    The controller sees the recorded readings of the camera and nothing else. ``servo`` is the
    time constant of the servos, and ``rolling`` the decay of the velocity.
    """
    servo, rolling = physics['servo'], physics['rolling']

    def rates(x: Vector, u: Vector) -> Vector:
        _, _, vx, vy, alpha, beta = x
        return (
            vx, vy, 7.0 * alpha - rolling * vx, 7.0 * beta - rolling * vy,
            (u[0] - alpha) / servo, (u[1] - beta) / servo,
        )  # fmt: skip

    errors = list[Array]()
    belief = np.zeros((2, 2))  # of the controller: place and velocity

    def balance(t: float, x: Vector) -> Vector:
        errors.append(rng.normal(0.0, 0.003, 2))
        belief[0] += 0.04 * belief[1]
        surprise = np.array(x[:2]) + errors[-1] - belief[0]
        belief[0] += 0.4 * surprise
        belief[1] += 1.5 * surprise
        wish = 0.12 * square(t, 8.0), 0.1 * math.sin(0.9 * t)
        tilt = 0.35 * (np.array(wish) - belief[0]) - 0.3 * belief[1]
        return [float(part) for part in tilt.clip(-0.2, 0.2)]

    start = rng.normal(0.0, [0.05, 0.05, 0.05, 0.05, 0.01, 0.01])
    density = [0, 0, 0.0004, 0.0004, 1e-5, 1e-5]
    truth = integrate(rates, start, density, physics['seconds'], 0.005, rng, balance, 0.04)
    seen: Channel = commanded(truth, 'ball', 'point')
    seen.value, seen.noise = truth.state[:-1:8, :2].copy(), np.array(errors)
    seen.received -= 3e-4  # before the command that it leads to
    seen.sensor = True
    return {
        'camera': seen,
        'tilt': sampled(truth, 'tilt', 'plate', 50.0, lambda x: [x[4], x[5]], [0.003, 0.003], rng),
        'input': commanded(truth, 'servos', 'plate'),
    }
