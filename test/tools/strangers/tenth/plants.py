# SPDX-License-Identifier: Apache-2.0
"""Plants: a web of paper between two rolls, and a fermenter. Inputs are programs of time."""

from __future__ import annotations

import math

import numpy as np

from ..second.vehicles import Physics
from ..simulation import Array, Readings, Vector, column, commanded, integrate, sampled, square


def web(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return a minute of paper that is pulled off a roll with a brake by one with a motor.

    ``stiff`` is the stiffness of the paper, ``brake`` the force of the brake by what is
    recorded, and ``offset`` a force on the second roll that nobody records. From ``halt`` on, the
    forces stay as they are for 15 s.
    """
    stiff, brake, offset = physics['stiff'], physics['brake'], physics['offset']
    halt = physics['halt']

    def rates(x: Vector, u: Vector) -> Vector:
        first, tension, second = x
        return (
            (tension - brake * u[0] - 20.0 * first) / 50.0,
            stiff * (second - first) - 2.0 * tension,
            (u[1] + offset - tension - 20.0 * second) / 40.0,
        )

    def pull(t: float, x: Vector) -> Vector:
        if halt <= t < halt + 15.0:
            t = halt
        return (
            60.0 + 20.0 * square(t, 9.0) + 8.0 * math.sin(1.7 * t),
            140.0 + 30.0 * square(t + 1.0, 6.5) + 12.0 * math.sin(3.1 * t),
        )

    start = rng.normal([2.0, 100.0, 2.13], [0.1, 5.0, 0.1])
    truth = integrate(
        rates, start, [0.001, 5.0, 0.001], physics['seconds'], 0.002, rng, pull, 0.02
    )
    return {
        'unwinder': sampled(truth, 'unwinder', 'unwinder', 50.0, lambda x: [4 * x[0]], [0.1], rng),
        'load': sampled(truth, 'load', 'force', 50.0, column(1), [1.5], rng),
        'rewinder': sampled(truth, 'rewinder', 'rewinder', 50.0, lambda x: [5 * x[2]], [0.1], rng),
        'input': commanded(truth, 'rolls', 'rolls'),
    }


def fermenter(rng: np.random.Generator, physics: Physics) -> Readings:
    """Return two hours of yeast that is fed with sugar, and stirred.

    ``growth`` is the fastest growth in 1/s, and ``pump`` what flows by what is recorded.
    """
    growth, pump = physics['growth'], physics['pump']

    def grown(cells: Array | float, sugar: Array | float) -> Array:
        least = np.maximum(sugar, 0.0)
        return np.asarray(growth * cells * least / (0.3 + least))

    def rates(x: Vector, u: Vector) -> Vector:
        cells, sugar, oxygen = x
        least = max(sugar, 0.0)
        new, fed = growth * cells * least / (0.3 + least), pump * u[0] / 2000.0
        return (
            new - fed * cells, fed * (50.0 - sugar) - new / 0.5,
            0.02 * u[1] * (100.0 - oxygen) - 1400.0 * new,
        )  # fmt: skip

    def feed(t: float, x: Vector) -> Vector:
        # as much more as grows with time
        return (
            (0.045 + 0.03 * square(t, 1500.0)) * math.exp(5e-5 * t),
            1.2 + 0.25 * square(t + 300.0, 820.0) + 0.1 * math.sin(0.011 * t),
        )

    start = rng.normal([6.0, 1.2, 65.0], [0.1, 0.1, 2.0])
    density = [4e-7, 4e-7, 0.02]
    truth = integrate(rates, start, density, physics['seconds'], 1.0, rng, feed, 20.0)
    return {
        'turbidity': sampled(
            truth, 'turbidity', 'gauge', 0.1, lambda x: [1.8 * x[0]], [0.1], rng
        ),
        'analyser': sampled(truth, 'sugar', 'speed', 1 / 60, column(1), [0.06], rng),
        'oxygen': sampled(truth, 'oxygen', 'humidity', 0.2, column(2), [1.0], rng),
        'gas': sampled(
            truth, 'gas', 'pressure', 0.1, lambda x: [2000.0 * grown(x[0], x[1])], [0.05], rng
        ),
        'input': commanded(truth, 'pumps', 'feed_and_stirrer'),
    }  # fmt: skip
