# SPDX-License-Identifier: Apache-2.0
"""Plants: a rolling mill, a small grid, a footbridge, and a patient with an infusion.

Inputs are programs of time.
"""

from __future__ import annotations

import math

import numpy as np

from ..second.vehicles import Physics
from ..simulation import Array, Readings, Vector, column, commanded, integrate, sampled, square


def mill(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return half a minute of a motor that turns a roll by a shaft that twists.

    ``roll`` is the inertia of the roll, ``shaft`` the stiffness, and ``slab`` a torque that
    brakes the roll for 3 s.
    """
    roll, shaft, slab = physics['roll'], physics['shaft'], physics['slab']

    def torque(x: Vector | Array) -> Array | float:
        return shaft * x[2] + 1.5 * (x[1] - x[3])

    def rates(x: Vector, u: Vector) -> Vector:
        _, motor, _, load, since = x
        pull = float(torque(x))
        brake = slab if 12.0 <= since < 15.0 else 0.0
        return (
            load, (u[0] - pull - 0.8 * motor) / 0.5, motor - load,
            (pull - 1.2 * load - brake) / roll, 1.0,
        )  # fmt: skip

    def drive(t: float, x: Vector) -> Vector:
        return (14.0 * square(t, 3.1) + 7.0 * math.sin(1.9 * t) + 6.0 * math.sin(11.0 * t),)

    start = [*rng.normal(0.0, [0.02, 0.2, 0.005, 0.2]), 0.0]
    density = [0, 0.02, 0, 0.005, 0]
    truth = integrate(rates, start, density, physics['seconds'], 0.001, rng, drive, 0.01)
    return {
        'encoder': sampled(truth, 'encoder', 'angle', 100.0, column(0), [0.004], rng),
        'resolver': sampled(truth, 'resolver', 'turning', 100.0, column(1), [0.08], rng),
        'torque': sampled(
            truth, 'torque', 'twist_of_shaft', 50.0, lambda x: [torque(x)], [0.6], rng
        ),
        'input': commanded(truth, 'drive', 'drive_torque'),
    }


def microgrid(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of a bus of 48 V, with a line to it and a capacitor on it.

    ``coil`` is the inductance of the line, ``store`` the capacitance of the capacitor, and
    ``leak`` a current that nobody records.
    """
    coil, store, leak = physics['coil'], physics['store'], physics['leak']

    def rates(x: Vector, u: Vector) -> Vector:
        line, bus, cell = x
        charge = (bus - cell) / 0.5
        return (
            (u[0] - 0.4 * line - bus) / coil, (line - u[1] - leak - charge) / 0.2, charge / store,
        )  # fmt: skip

    def supply(t: float, x: Vector) -> Vector:
        return (
            50.0 + 3.0 * square(t, 17.0) + 2.0 * math.sin(2.7 * t),
            8.0 + 4.0 * square(t + 2.0, 6.4) + 1.5 * math.sin(1.3 * t),
        )

    start = rng.normal([8.0, 47.0, 47.0], [0.5, 0.3, 0.3])
    density = [0.05, 0.1, 0.002]
    truth = integrate(rates, start, density, physics['seconds'], 0.002, rng, supply, 0.02)
    return {
        'shunt': sampled(truth, 'shunt', 'gauge', 50.0, column(0), [0.15], rng),
        'voltmeter': sampled(truth, 'bus', 'battery', 50.0, column(1), [0.1], rng),
        'monitor': sampled(truth, 'cell', 'battery', 10.0, column(2), [0.05], rng),
        'input': commanded(truth, 'supply', 'supply'),
    }


def footbridge(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute and a half of two modes of a footbridge that a shaker excites, in mm.

    ``first`` is the rate of the first mode, and ``crowd`` the density of the pushes by the file's.
    """
    first, crowd = physics['first'], physics['crowd']

    def rates(x: Vector, u: Vector) -> Vector:
        low, slow, high, fast = x
        return (
            slow, -(first**2) * low - 0.24 * slow + 30.0 * u[0],
            fast, -196.0 * high - 0.6 * fast + 42.0 * u[0],
        )  # fmt: skip

    def shake(t: float, x: Vector) -> Vector:
        swept = math.sin((4.0 + 0.06 * t) * t)
        return (1.6 * swept + 1.2 * square(t, 3.7) + 0.8 * math.sin(12.6 * t),)

    start = rng.normal(0.0, [0.5, 2.0, 0.2, 2.0])
    density = [0, 20.0 * crowd, 0, 20.0 * crowd]
    truth = integrate(rates, start, density, physics['seconds'], 0.002, rng, shake, 0.02)
    return {
        'middle': sampled(truth, 'middle', 'climb', 50.0, column(1), [1.0], rng),
        'quarter': sampled(
            truth, 'quarter', 'climb', 50.0, lambda x: [0.7 * x[1] + x[3]], [1.0], rng
        ),
        'laser': sampled(truth, 'laser', 'range', 25.0, column(0), [0.2], rng),
        'strain': sampled(
            truth, 'strain', 'gauge', 25.0, lambda x: [2.0 * x[0] + 8.0 * x[2]], [0.8], rng
        ),
        'input': commanded(truth, 'shaker', 'push_up'),
    }  # fmt: skip


def infusion(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return 40 minutes of a patient with a pump: drug in blood and tissue, and its effect.

    ``clearance`` is the rate at which the blood loses it in 1/s, ``half`` what has half of the
    effect in mg/l, and ``pump`` what flows by what is recorded.
    """
    clearance, half, pump = physics['clearance'], physics['half'], physics['pump']

    def rates(x: Vector, u: Vector) -> Vector:
        blood, tissue, brain = x
        swap = 0.003 * blood - 0.0015 * tissue
        return (pump * u[0] / 4.0 - clearance * blood - swap, swap, 0.01 * (blood - brain))

    def give(t: float, x: Vector) -> Vector:
        return (0.045 + 0.035 * square(t, 430.0) + 0.01 * math.sin(0.031 * t),)

    def awake(x: Array) -> list[Array]:
        share = (np.maximum(x[2], 0.0) / half) ** 2
        return [95.0 / (1.0 + share)]

    start = rng.normal([3.0, 4.0, 3.0], [0.2, 0.3, 0.2])
    density = [2e-5, 1e-6, 1e-6]
    truth = integrate(rates, start, density, physics['seconds'], 0.1, rng, give, 2.0)
    return {
        'analyser': sampled(truth, 'analyser', 'speed', 0.1, column(0), [0.08], rng),
        'breath': sampled(truth, 'breath', 'pressure', 0.5, column(0), [0.3], rng),
        'monitor': sampled(truth, 'monitor', 'temperature', 0.5, awake, [2.0], rng),
        'input': commanded(truth, 'pump', 'number'),
    }
