# SPDX-License-Identifier: Apache-2.0
"""Plants: a voice coil, a patient with an insulin pump, and a tunnel to a turbine.

Inputs are programs of time.
"""

from __future__ import annotations

import math

import numpy as np

from ..second.vehicles import Physics
from ..simulation import Array, Readings, Vector, column, commanded, integrate, sampled, square


def voicecoil(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return fifty seconds of a coil in a magnet, on a spring, with a mirror; lengths in mm.

    ``mass`` is what moves in kg, ``magnet`` the force by current in N/A, ``ohms`` the resistance,
    ``least`` the voltage below which the amplifier does nothing, and ``halt`` when the voltage
    rests for 15 s.
    """
    mass, magnet, ohms = physics['mass'], physics['magnet'], physics['ohms']
    least, halt = physics['least'], physics['halt']

    def push(x: Vector | Array) -> Array | float:
        return (-160.0 * x[0] - 2.0 * x[1] + 1000.0 * magnet * x[2]) / mass

    def rates(x: Vector, u: Vector) -> Vector:
        volts = math.copysign(max(abs(u[0]) - least, 0.0), u[0])
        current = (volts - ohms * x[2] - 0.001 * magnet * x[1]) / 0.08
        return x[1], float(push(x)), current

    def amplify(t: float, x: Vector) -> Vector:
        if halt <= t < halt + 15.0:
            return (0.0,)
        return (2.4 * square(t, 1.9) + 1.6 * math.sin(7.0 * t) + 1.2 * math.sin(19.0 * t),)

    start = rng.normal(0.0, [2.0, 20.0, 0.05])
    density = [0, 300.0, 0.002]
    truth = integrate(rates, start, density, physics['seconds'], 0.001, rng, amplify, 0.02)
    return {
        'hall': sampled(truth, 'hall', 'range', 50.0, column(0), [0.5], rng),
        'shunt': sampled(truth, 'shunt', 'gauge', 50.0, column(2), [0.02], rng),
        'accelerometer': sampled(
            truth, 'imu', 'imu', 50.0, lambda x: [0, 0, 0, push(x) / 1000.0, 0, 9.80665],
            [0.01] * 3 + [0.3] * 3, rng,
        ),
        'input': commanded(truth, 'amplifier', 'drive_torque'),
    }  # fmt: skip


def glucose(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return eight hours of a patient with meals and an insulin pump, after Bergman's model.

    ``sensitivity`` is the fall of glucose by insulin, ``skin`` the lag of the skin in s, ``pump``
    what flows by what is recorded, and ``guess`` what is eaten by what is recorded.
    """
    sensitivity, skin = physics['sensitivity'], physics['skin']
    pump, guess = physics['pump'], physics['guess']

    def rates(x: Vector, u: Vector) -> Vector:
        blood, remote, insulin, tissue = x
        return (
            guess * u[1] - 2e-4 * (blood - 100.0) - sensitivity * remote * blood,
            6e-4 * (insulin - remote), pump * u[0] - 1.5e-3 * insulin, (blood - tissue) / skin,
        )  # fmt: skip

    def day(t: float, x: Vector) -> Vector:
        meal = 0.16 if math.fmod(t + 4500.0, 7200.0) < 1500.0 else 0.02
        bolus = 0.05 if math.fmod(t + 4200.0, 7200.0) < 1800.0 else 0.0
        return 0.02 + bolus + 0.006 * square(t, 3100.0), meal + 0.01 * square(t, 2300.0)

    start = rng.normal([140.0, 18.0, 18.0, 140.0], [5.0, 1.0, 1.0, 5.0])
    density = [0.008, 4e-5, 4e-5, 0.002]
    truth = integrate(rates, start, density, physics['seconds'], 2.0, rng, day, 60.0)
    return {
        'sensor': sampled(truth, 'sensor', 'gauge', 1 / 60, column(3), [2.0], rng),
        'lab': sampled(truth, 'lab', 'speed', 1 / 200, column(0), [1.5], rng),
        'assay': sampled(truth, 'assay', 'pressure', 1 / 100, column(2), [0.5], rng),
        'input': commanded(truth, 'pump', 'insulin_and_meal'),
    }


def penstock(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return 25 minutes of water in a tunnel to a turbine, with a surge tank between.

    ``friction`` is the loss in the tunnel by the square of the flow, ``area`` that of the tank,
    ``slow`` the lag of the gate, and ``halt`` when the gate rests for 300 s.
    """
    friction, area, slow = physics['friction'], physics['area'], physics['slow']
    halt = physics['halt']

    def used(x: Vector | Array) -> Array:
        return np.asarray(5.6 * x[2] * np.sqrt(80.0 + x[1]))

    def rates(x: Vector, u: Vector) -> Vector:
        flow, level, gate = x
        return (
            0.078 * (-level - friction * flow * abs(flow)),
            (flow - 5.6 * gate * math.sqrt(80.0 + level)) / area, (u[0] - gate) / slow,
        )  # fmt: skip

    def steer(t: float, x: Vector) -> Vector:
        if halt <= t < halt + 300.0:
            t = halt
        return (
            0.5 + 0.14 * square(t, 170.0) + 0.08 * square(t, 61.0) + 0.06 * math.sin(0.09 * t),
        )

    def power(x: Array) -> list[Array]:
        return [0.0088 * used(x) * (80.0 + x[1])]

    start = rng.normal([25.0, -1.9, 0.5], [1.0, 0.3, 0.02])
    density = [0.02, 0.0004, 0.00002]
    truth = integrate(rates, start, density, physics['seconds'], 0.1, rng, steer, 2.0)
    return {
        'level': sampled(truth, 'level', 'range', 1.0, column(1), [0.08], rng),
        'flow': sampled(truth, 'flow', 'speed', 1.0, column(0), [0.4], rng),
        'gate': sampled(truth, 'gate', 'gate', 1.0, column(2), [0.008], rng),
        'power': sampled(truth, 'power', 'gauge', 1.0, power, [0.2], rng),
        'input': commanded(truth, 'governor', 'number'),
    }
