# SPDX-License-Identifier: Apache-2.0
"""A simulator of its own: Runge and Kutta's steps with noise between them, and readings."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector = Sequence[float]
#: The change of the state in a second, of a state and an input.
Rates = Callable[[Vector, Vector], Vector]
#: The input, of the time and the true state.
Policy = Callable[[float, Vector], Vector]


@dataclass
class Track:
    """A simulated truth.

    Parameters
    ----------
    time
        In s, equally spaced.
    state
        The states at these times, a row each.
    command_time, command
        When an input began to act, and the input, a row each.
    """

    time: Array
    state: Array
    command_time: Array
    command: Array


@dataclass
class Channel:
    """The messages of one topic.

    Parameters
    ----------
    topic, form
        The name of the topic, and that of the message in ``messages.FORMS``.
    time
        When each reading was really taken, in s.
    value, noise
        Readings without noise, and their noise, a row each.
    stamp, received
        The times that the recording claims, in s.
    sensor
        Whether it is a sensor and not the input.
    """

    topic: str
    form: str
    time: Array
    value: Array
    noise: Array
    stamp: Array
    received: Array
    sensor: bool = True

    def keep(self, kept: NDArray[np.bool_]) -> None:
        """Lose all other messages."""
        for name in ('time', 'value', 'noise', 'stamp', 'received'):
            setattr(self, name, getattr(self, name)[kept])


Readings = dict[str, Channel]


def no_input(time: float, state: Vector) -> Vector:
    """Return the input of a system that has none."""
    return ()


def integrate(
    rates: Rates,
    start: Vector | Array,
    density: Vector,
    seconds: float,
    step: float,
    rng: np.random.Generator,
    policy: Policy = no_input,
    hold: float = 0.02,
) -> Track:
    """Return the track of x' = rates(x, u) + w, where w is white with this spectral density.

    The input is asked for every ``hold`` seconds and is constant between.
    """
    count, every = round(seconds / step), round(hold / step)
    deviations = np.sqrt(np.array(density) * step)
    pushes = (rng.standard_normal((count, len(start))) * deviations).tolist()
    x = [float(number) for number in start]
    u: Vector = ()
    states, inputs = [x], list[list[float]]()
    for k in range(count):
        if k % every == 0:
            u = policy(k * step, x)
            inputs.append(list(u))
        a = rates(x, u)
        b = rates([p + 0.5 * step * q for p, q in zip(x, a)], u)
        c = rates([p + 0.5 * step * q for p, q in zip(x, b)], u)
        d = rates([p + step * q for p, q in zip(x, c)], u)
        x = [
            p + step / 6.0 * (q + 2.0 * r + 2.0 * s + t) + w
            for p, q, r, s, t, w in zip(x, a, b, c, d, pushes[k])
        ]
        states.append(x)
    time: Array = step * np.arange(count + 1, dtype=np.float64)
    return Track(time, np.array(states), time[:-1:every], np.array(inputs))


def sampled(
    track: Track,
    topic: str,
    form: str,
    rate: float,
    reading: Callable[[Array], Sequence[Array | float]],
    noise: Vector,
    rng: np.random.Generator,
) -> Channel:
    """Return what a sensor reads of a track, at a rate in Hz that jitters by a tenth.

    ``reading`` maps the states (n, N) to the coordinates of the readings.
    """
    step = track.time[1]
    stride = round(1.0 / (rate * step))
    nominal = np.arange(rng.integers(1, stride + 1), len(track.time) - stride, stride)
    index = nominal + rng.integers(-(stride // 10), stride // 10 + 1, len(nominal))
    index = index.clip(1)
    rows = np.broadcast_arrays(*reading(track.state[index].T), track.time[index])[:-1]
    value = np.stack(rows, axis=-1).astype(float)
    error = rng.standard_normal(value.shape) * np.array(noise)
    time = track.time[index]
    return Channel(
        topic, form, time, value, error, time.copy(), time + rng.uniform(0.001, 0.003, len(time))
    )


def commanded(track: Track, topic: str, form: str) -> Channel:
    """Return the messages of the input."""
    time = track.command_time
    still = np.zeros_like(track.command)
    return Channel(
        topic, form, time, track.command.copy(), still, time.copy(), time + 5e-4, sensor=False
    )


def column(k: int) -> Callable[[Array], list[Array]]:
    """Return the reading of one state."""
    return lambda x: [x[k]]


def square(time: float, period: float) -> float:
    """Return 1 in the first half of each period, and -1 in the second."""
    return 1.0 if math.fmod(time, period) < 0.5 * period else -1.0
