# SPDX-License-Identifier: Apache-2.0
"""How wrong a model may be before its loop is unstable: gain, phase, delay and disk margins.

A loop L is closed by u = -L u. For a state feedback it is K (s I - A)^-1 B, for a
`compensator` H and a plant P it is ``H @ P``, broken at the input of the plant. Margins
require a stable closed loop; the open one need not be stable.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import atan, inf, nan, pi

import numpy as np

from kalman_ros.core import Array, DesignError
from kalman_ros.linear.structure import describe, unstable

from .crossings import continuous, frequency, level_candidates, level_crossings, real_crossings
from .state_space import StateSpace

#: The peak of a response is found to this, relative to it.
_PEAK = 1e-9
#: A maximum is climbed with these steps, relative to a width, which is at first this part of the
#: frequency, and at last this.
_STEPS = np.linspace(-1.0, 1.0, 17)
_WIDE, _NARROW = 0.1, 1e-8
#: A loop that crosses the real axis this close to 0, or this far away, does so by rounding.
_TINY = 1e-10


@dataclass(frozen=True)
class Margin:
    """A change that brings the loop to the stability boundary, and its frequency there.

    Parameters
    ----------
    value
        The change, in its unit.
    frequency
        In rad/s; NaN if there is no such change.
    """

    value: float
    frequency: float = nan


@dataclass(frozen=True)
class DiskMargin:
    """The largest simultaneous change of gain and phase (Seiler, Packard and Gahinet, 2020).

    The loop stays stable under every factor (1 + d/2) / (1 - d/2), |d| < alpha, which may be
    complex and vary with frequency: the symmetric margin, of S - T.

    Parameters
    ----------
    alpha
        0 to 2. At 2 every factor with a positive real part is safe; larger changes, which some
        loops tolerate, are not measured.
    frequency
        The worst frequency, in rad/s.
    """

    alpha: float
    frequency: float

    @classmethod
    def of_peak(cls, peak: float, frequency: float) -> DiskMargin:
        """Return the margin of a loop with this peak of S - T."""
        return cls(2.0 / max(peak, 1.0), frequency)

    @property
    def upper_gain(self) -> float:
        """Every gain below this factor, and above its inverse, is safe."""
        return (2.0 + self.alpha) / (2.0 - self.alpha) if self.alpha < 2.0 else inf

    @property
    def lower_gain(self) -> float:
        """Every gain above this factor, and below its inverse, is safe."""
        return (2.0 - self.alpha) / (2.0 + self.alpha)

    @property
    def phase(self) -> float:
        """Every smaller phase change in radians, lead or lag, is safe."""
        return 2.0 * atan(0.5 * self.alpha)


@dataclass(frozen=True)
class Margins:
    """The changes that the loop tolerates, one at a time: a value, and a frequency in rad/s.

    Parameters
    ----------
    lower_gain, upper_gain
        Factors of the gain between which it is stable; 0 and inf without bounds.
    lead, lag
        Phases in radians, up to half a turn, that can be added, or lost, at all
        frequencies; inf without a bound. The lag is the usual phase margin.
    delay
        Seconds of delay beyond the loop's own. In a sampled loop a delay that is no whole number
        of samples also changes the gain (see `sampled_plant`), which is ignored here.
    disk
        Of gain and phase together.
    distance
        The least distance of L from -1, min|1 + L|, and where: one over the peak
        of the sensitivity. At most 1 for a loop with more poles than zeros.
    """

    lower_gain: Margin
    upper_gain: Margin
    lead: Margin
    lag: Margin
    delay: Margin
    disk: DiskMargin
    distance: Margin

    def __str__(self) -> str:
        lead, lag = (_bound(np.degrees(at.value), 'deg') for at in (self.lead, self.lag))
        return (
            f'gain {self.lower_gain.value:.3g} to {self.upper_gain.value:.3g}, '
            f'lead {lead}, lag {lag}, delay {_bound(self.delay.value, "s")}, '
            f'disk {self.disk.alpha:.3g}, min|1 + L| {self.distance.value:.3g}'
        )

    __repr__ = __str__  # what a notebook shows


#: A bound from which on a loop has none, in degrees or seconds.
_BEYOND = 1e6


def _bound(value: float, unit: str) -> str:
    return f'{value:.3g} {unit}' if value < _BEYOND else 'any'


def margins(loop: StateSpace) -> Margins:
    """Return the margins of a scalar loop (1, 1), continuous or sampled.

    The unchanged loop must be stable, which is checked. A growing change can destabilise it only
    where 1 + L with it is 0 on the boundary, so the first such change is the margin, whatever the
    number of unstable open-loop poles.

    Raises
    ------
    ValueError
        If the loop is not scalar; see `loop_at_a_time`.
    DesignError
        If the closed loop is not stable.
    """
    if loop.D.shape != (1, 1):
        raise ValueError(
            f'loop: expected one input and one output, got {loop.D.shape[1]} and {len(loop.D)}'
        )
    closed = loop.closed()
    if not closed.stable:
        poles = unstable(closed.poles, sampled=loop.sampled)
        raise DesignError(f'loop: unstable when closed, with poles at {describe(poles)}')
    bent = continuous(loop)
    lower, upper = _gains(bent, loop.dt)
    lead, lag, delay = _phases(bent, loop.dt)
    T = bent.closed()
    # S - T = 1 - 2 T and S = 1 - T
    most, worst = peak(StateSpace(T.A, T.B, -2.0 * T.C, 1.0 - 2.0 * T.D))
    disk = DiskMargin.of_peak(most, frequency(worst, loop.dt))
    most, nearest = peak(StateSpace(T.A, T.B, -T.C, 1.0 - T.D))
    distance = Margin(1.0 / most if most else inf, frequency(nearest, loop.dt))
    return Margins(lower, upper, lead, lag, delay, disk, distance)


def loop_at_a_time(loop: StateSpace) -> tuple[Margins, ...]:
    """Return the margins of each input of a loop (m, m) while all others are closed as designed.

    Small simultaneous changes of several inputs may destabilise what each alone does not: see
    `simultaneous.simultaneous_disk`.

    Raises
    ------
    DesignError
        If the closed loop is not stable.
    """
    return tuple(margins(loop.channel(index)) for index in range(len(loop.D)))


def _gains(loop: StateSpace, dt: float | None) -> tuple[Margin, Margin]:
    """Return the lower and the upper gain margin: the nearest k with 1 + k L = 0 on the axis."""
    crossings = {frequency(w, dt): _at(loop, w).real for w in real_crossings(loop).tolist()}
    crossings |= {0.0: _at(loop, 0.0).real, frequency(inf, dt): float(loop.D[0, 0])}
    candidates = [
        Margin(-1.0 / L, w) for w, L in crossings.items() if _TINY < abs(L) < 1.0 / _TINY
    ]
    lower = max((m for m in candidates if 0.0 < m.value < 1.0), key=_value, default=Margin(0.0))
    return lower, min((m for m in candidates if m.value > 1.0), key=_value, default=Margin(inf))


def _at(loop: StateSpace, w: float) -> complex:
    """Return L(jw), inf at a pole."""
    try:
        return complex(loop.at(1j * w)[0, 0])
    except np.linalg.LinAlgError:
        return complex(inf)


def _value(margin: Margin) -> float:
    return margin.value


def _phases(loop: StateSpace, dt: float | None) -> tuple[Margin, Margin, Margin]:
    """Return lead, lag and delay: the changes that turn L(jw) with |L| = 1 to -1."""
    turns = {
        frequency(w, dt): float(np.angle(-_at(loop, w))) for w in level_crossings(loop).tolist()
    }
    lead = _least({w: -turn for w, turn in turns.items() if turn < 0.0})
    lag = _least({w: turn for w, turn in turns.items() if turn > 0.0})
    delay = _least({w: turn % (2.0 * pi) / w for w, turn in turns.items()})
    if dt is None and abs(loop.D[0, 0]) >= 1.0:
        delay = Margin(0.0, inf)  # at high frequencies any delay turns L full circle
    return lead, lag, delay


def _least(by_frequency: dict[float, float]) -> Margin:
    """Return the least of margins by their frequency."""
    return min(
        (Margin(value, w) for w, value in by_frequency.items()), key=_value, default=Margin(inf)
    )


def peak(M: StateSpace) -> tuple[float, float]:
    """Return max|M| of a stable continuous scalar system, and where.

    Every part of the axis on which |M| exceeds a level lies between two neighbouring frequencies
    at which it crosses that level (S. Boyd and V. Balakrishnan, Systems and Control Letters 15,
    1990; N. Bruinsma and M. Steinbuch, 14, 1990). The level is raised to the highest value between
    crossings, until none is higher. Where rounding moves crossings, a part begins and ends
    elsewhere, but is not missed: none is left out for its distance from the axis.
    """

    def sizes(w: Array) -> Array:
        return np.abs(M.response(w)[:, 0, 0])

    starts = np.abs(np.concatenate(([0.0], M.poles, M.poles.imag)))
    at, most = _highest(sizes, starts)
    if abs(M.D[0, 0]) >= most:
        at, most = inf, abs(float(M.D[0, 0]))
    while True:
        level = most * (1.0 + _PEAK)
        ends = np.sort(np.concatenate((starts[starts > 0.0], level_candidates(M, level))))
        ends = np.concatenate((0.5 * ends[:1], ends, 2.0 * ends[-1:]))
        highest = _highest(sizes, np.sqrt(ends[:-1] * ends[1:]))
        if not highest[1] > level:
            return most, at
        at, most = highest


def _highest(sizes: Callable[[Array], Array], w: Array) -> tuple[float, float]:
    """Return the frequency of the largest of the sizes at ``w``, climbed from there, and it."""
    values, width = sizes(w), _WIDE
    if not w.size:
        return 0.0, 0.0
    while True:
        best = int(np.argmax(values))
        at, peak = float(w[best]), float(values[best])
        if width < _NARROW:
            return at, peak
        w = at * (1.0 + width * _STEPS)
        values, width = sizes(w), width / _STEPS.size
