# SPDX-License-Identifier: Apache-2.0
"""Least squares on one reading is no substitute for an observer.

Of a cart only the position is measured: C'C is singular and y does not contain the velocity,
which an observer estimates over time. Of two currents two sums are measured: C can be inverted,
and the inverse passes on all sensor noise, which a filter does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.analysis.checks import Check
from kalman_ros.control.lqe import dlqe
from kalman_ros.core import Array, Transition
from kalman_ros.linear.structure import observed

from . import Findings, close
from .stationary import Stationary, estimation_error, white
from .study_run import ran
from .systems import CART_READING, cart, plant

DT, NOISE = 0.02, 0.1
CART = cart([0.0, 0.1], NOISE, 1.0 / DT, enabled=False)
CURRENTS = {'model': 'current_sensors', 'rate': 1.0 / DT, 'currents.rate': 1.0 / DT}
#: Coefficients of each sensor for (i_m, i_t), and its noise, as in the model.
CURRENTS_READING = np.array([[1.0, 1.0], [0.0, 1.0]])
CURRENTS_NOISE = np.diag([0.5**2, 0.3**2])
#: Seconds in which a filter forgets its start: over ten time constants of the slower filter.
SETTLED = 6.0


@dataclass(frozen=True)
class Watched:
    """The state, its estimate (N, n) and the reading (N, k) of each step after the start."""

    time: Array
    truth: Array
    estimate: Array
    readings: Array

    @property
    def error(self) -> Array:
        """Error of the estimate (N, n)."""
        return self.truth - self.estimate


def study(size: float = 1.0) -> Findings:
    """Run a cart and two currents for 46 s each."""
    place, currents = _watch(CART, size), _watch(CURRENTS, size)
    checks = [*_place_checks(place), *_current_checks(currents)]
    return Findings(checks, lambda path: _draw(place, currents, path))


def _watch(parameters: dict[str, Any], size: float) -> Watched:
    trajectory = ran(parameters, seconds=SETTLED + 40.0 * size)
    (readings,) = trajectory.readings.values()
    at = np.searchsorted(readings.time, trajectory.time - 0.5 * DT)
    whole = (trajectory.time, trajectory.truth, trajectory.estimate, readings.values[at])
    return Watched(*(column[trajectory.time > SETTLED] for column in whole))


def _inverted(C: Array, readings: Array) -> Array:
    """Return the minimum-norm least-squares state (N, n) of each reading."""
    return np.asarray(readings @ np.linalg.pinv(C).T)


def _filtered(step: Transition, C: Array, R: Array) -> Stationary:
    """Return the error of the Kalman filter, by the Riccati equation."""
    return estimation_error(step, C, R, dlqe(step.F, C, step.Q, R).gain)


def _difference_error(step: Transition, variance: float) -> Stationary:
    """Return the error of the difference quotient, (y - y_before) / dt - v, as coordinate 0.

    In terms of the noises it is (w_x + r - r_before) / dt - w_v; coordinate 1 stores r.
    """
    through = np.array([[1.0 / DT, -1.0, 1.0 / DT], [0.0, 0.0, 1.0]])
    noises = np.zeros((3, 3))
    noises[:2, :2], noises[2, 2] = step.Q, variance
    return Stationary(np.array([[0.0, -1.0 / DT], [0.0, 0.0]]), through @ noises @ through.T)


def _place_checks(cart: Watched) -> list[Check]:
    """Compare the states determined by one reading with those determined over time."""
    system = plant(CART)
    step, C, R = system.sampled(DT), CART_READING, np.array([[NOISE**2]])
    rank = float(np.linalg.matrix_rank(C.T @ C))
    seen = float(observed(system.A, C).sum())
    moved = float(np.abs(_inverted(C, cart.readings)[:, 1]).max())
    quotient = np.diff(cart.readings[:, 0]) / DT
    filtered = _filtered(step, C, R)
    return [
        close("cart: rank of C'C, of 2", '', 1.0, rank, 0.0),
        close('cart: states seen over time', '', 2.0, seen, 0.0),
        close('cart: largest v by least squares', 'm/s', 0.0, moved, 0.0),
        _difference_error(step, NOISE**2).rms(
            'RMS error of v, differences', 'm/s', 0, quotient - cart.truth[1:, 1]
        ),
        filtered.rms('RMS error of v, filter', 'm/s', 1, cart.error[:, 1]),
        filtered.rms('RMS error of x, filter', 'm', 0, cart.error[:, 0]),
    ]


def _current_checks(currents: Watched) -> list[Check]:
    """Compare the errors of the inverse and of the filter with theory, for each current."""
    step, C, R = plant(CURRENTS).sampled(DT), CURRENTS_READING, CURRENTS_NOISE
    inverse = np.linalg.inv(C)
    errors = {
        'inverse': (white(inverse @ R @ inverse.T), _inverted(C, currents.readings)),
        'filter': (_filtered(step, C, R), currents.estimate),
    }
    return [
        theory.rms(
            f'RMS error of {name}, {way}', 'A', index, (currents.truth - estimate)[:, index]
        )
        for way, (theory, estimate) in errors.items()
        for index, name in enumerate(('i_m', 'i_t'))
    ]


def _draw(cart: Watched, currents: Watched, path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, READING, TRUTH, picture

    count = min(len(cart.time) - 1, round(6.0 / DT))
    quotient = np.diff(cart.readings[:, 0]) / DT
    inverted = _inverted(CURRENTS_READING, currents.readings)
    with picture(path, 2, 1, (8.0, 4.4)) as (_, ((speed,), (current,))):
        time = cart.time[1 : count + 1]
        speed.plot(
            time,
            quotient[:count],
            '.',
            ms=3,
            color=READING,
            label='difference quotient of y\n(most lie outside)',
        )
        least = _inverted(CART_READING, cart.readings)[1 : count + 1, 1]
        speed.plot(time, least, '--', color=INPUT, label="least squares, (C'C)⁺ C'y")
        speed.plot(time, cart.truth[1 : count + 1, 1], color=TRUTH, label='truth')
        speed.plot(time, cart.estimate[1 : count + 1, 1], color=ESTIMATE, label='filter')
        speed.set_ylim(-4.0, 4.0)
        speed.set_ylabel('v [m/s]')
        speed.set_title('A cart of which the place is read')
        time = currents.time[:count]
        current.plot(time, inverted[:count, 0], '.', ms=3, color=READING, label='inverse, C⁻¹ y')
        current.plot(time, currents.truth[:count, 0], color=TRUTH, label='truth')
        current.plot(time, currents.estimate[:count, 0], color=ESTIMATE, label='filter')
        current.set_ylabel('i_m [A]')
        current.set_title('Two currents of which two sums are read')
        for axis in (speed, current):
            axis.legend(loc='center left', bbox_to_anchor=(1.0, 0.5), markerscale=2)
