# SPDX-License-Identifier: Apache-2.0
"""P grows by Q and shrinks by the gain; a reading is a product of two Gaussians.

Forty levels wander at random. One filter estimates all of them, and another has the steady-state
gain from the first reading on. The true levels are as far apart as the initial belief is wide, so
that the mean square over the levels is the variance of the error, of both filters and at every
step.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from kalman_ros.analysis.checks import Check
from kalman_ros.control.lqe import dlqe
from kalman_ros.core import Array, Signal
from kalman_ros.simulation.trajectory import Trajectory

from . import Findings, close, largest
from .stationary import SIGMAS
from .study_run import StudyRun
from .systems import linear

BoolArray = npt.NDArray[np.bool_]

LEVELS, DT, EVERY = 40, 0.05, 10
#: Variances of the initial belief, of the noise of a step, and of a reading; of any unit.
FIRST, Q, R = 25.0, 0.01, 1.0
#: Seconds, and the part of them that counts as the start.
SECONDS, START = 20.0, 5.0
#: Rounding of numbers in double precision.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Filters:
    """The run with the Kalman filter, and the estimates (N, levels) with the steady-state gain."""

    run: Trajectory
    steady: Array

    @property
    def read(self) -> BoolArray:
        """Mask of the steps that have a reading (N,)."""
        read: BoolArray = np.arange(len(self.run.time)) % EVERY == 0
        return read


def study(size: float = 1.0) -> Findings:
    """Run both filters for 20 s, in which the gain becomes steady."""
    names = [f'x{k}' for k in range(LEVELS)]
    truth = ndtri((np.arange(LEVELS) + 0.5) / LEVELS)
    truth *= np.sqrt(FIRST / np.mean(truth**2))
    system = linear(
        dict.fromkeys(names, ''), np.zeros((LEVELS, LEVELS)), np.eye(LEVELS),
        np.full(LEVELS, Q / DT), np.eye(LEVELS), [float(np.sqrt(R))] * LEVELS,
        rate=1.0 / DT, reading__rate=1.0 / DT / EVERY, initial_state=truth.tolist(),
        initial_std=[float(np.sqrt(FIRST))] * LEVELS, enabled=False,
    )  # fmt: skip
    fields = tuple(f'position[{name}]' for name in names)
    with StudyRun(
        system, also={'steady': 'estimator'}, only={'steady': {'filter': 'steady_state'}},
        remaps={'steady': {'estimate': 'steady/estimate',
                           'estimate/covariance': 'steady/covariance'}},
        record={'steady/estimate': Signal('', 'sensor_msgs/JointState', fields)},
    ) as run:  # fmt: skip
        run.advance(SECONDS)
        trajectory = run.trajectory()
        steady = run.recorder['steady/estimate'].values[: len(trajectory.time)]
    filters = Filters(trajectory, steady)
    return Findings(_checks(filters), lambda path: _draw(filters, path))


def kalman_gains(read: BoolArray) -> Array:
    """Return L = P / (P + R) at each step (N,); 0 without a reading, by ``read`` (N,)."""
    P, gains = FIRST - Q, np.zeros(len(read))
    for step, has_reading in enumerate(read):
        P = P + Q
        if has_reading:
            gains[step] = P / (P + R)
            P = (1.0 - gains[step]) * P
    return gains


def variances(gains: Array) -> Array:
    """Return the variance of the error after each step (N,), with any gains (N,).

    A step adds Q, and a reading makes P = (1 - L)^2 P + L^2 R; the first step is the first belief.
    """
    P, values = FIRST - Q, []
    for L in gains:
        P = (1.0 - L) ** 2 * (P + Q) + L**2 * R
        values.append(P)
    return np.array(values)


def _steady_gain() -> float:
    one = np.eye(1)
    return float(dlqe(one, one, EVERY * Q * one, R * one).gain[0, 0])


def _steady_gains(read: BoolArray) -> Array:
    gains: Array = np.where(read, _steady_gain(), 0.0)
    return gains


def _checks(filters: Filters) -> list[Check]:
    """Compare P, L and estimates with the recursion, and the errors with theory."""
    run, read = filters.run, filters.read
    gains, P = kalman_gains(read), run.covariance[:, 0, 0]
    grown = np.diff(P)[~read[1:]]
    checks = [
        close('P grows without a reading by', '', Q, float(np.mean(grown)), ROUNDING),
        close('P over 20 s, off by', '', 0.0, largest(P - variances(gains)), ROUNDING),
        close('product of two Gaussians, off by', '', 0.0, _product_error(filters), ROUNDING),
    ]
    steps = np.flatnonzero(read)
    for step in steps[[1, 2, -1]]:
        L = float(gains[step])
        checks.append(close(f'L at {run.time[step]:g} s', '', L, _gain(filters, step), ROUNDING))
    # a change of the first P is left by (1 - L)^2 after each reading
    left = FIRST / R * (1.0 - _steady_gain()) ** (2 * len(steps) - 2)
    last = float(gains[steps[-1]])
    return [*checks, close('L in the end, of Riccati', '', _steady_gain(), last, left),
            *_losses(filters)]  # fmt: skip


def _losses(filters: Filters) -> list[Check]:
    """Compare the excess of the squared errors with the steady gain, at the start and later."""
    run = filters.run
    more = (run.truth - filters.steady) ** 2 - (run.truth - run.estimate) ** 2
    both = _steady_gains(filters.read), kalman_gains(filters.read)
    expected, start = (
        recursion(both[0]) - recursion(both[1])
        for recursion in (variances, lambda gains: np.cumprod((1.0 - gains) ** 2))
    )
    checks = []
    for name, part in (
        ('at the start', run.time < START),
        ('in the last 5 s', run.time > SECONDS - START),
    ):
        lost = DT * more[part].sum(axis=0)
        # the share of the first errors is known; the rest is noise
        noise = lost - DT * float(start[part].sum()) * run.truth[0] ** 2
        scatter = SIGMAS * float(noise.std(ddof=1) / np.sqrt(LEVELS))
        theory = DT * float(expected[part].sum())
        checks.append(close(f'lost {name}', 's', theory, float(lost.mean()), scatter))
    return checks


def _product_error(filters: Filters) -> float:
    """Return the largest difference of estimates from (x / P + y / R) / (1 / P + 1 / R)."""
    run, steps = filters.run, np.flatnonzero(filters.read)[1:]
    x, y = run.estimate[steps - 1], run.readings['reading'].values[1 : len(steps) + 1]
    P = (run.covariance[steps - 1, 0, 0] + Q)[:, np.newaxis]
    return largest(run.estimate[steps] - (x / P + y / R) / (1.0 / P + 1.0 / R))


def _gain(filters: Filters, step: int) -> float:
    """Return the ratio of the estimates' jumps to the innovations, over all levels."""
    run = filters.run
    y = run.readings['reading'].values[int(filters.read[:step].sum())]
    before = run.estimate[step - 1]
    return float((run.estimate[step] - before) @ (y - before) / ((y - before) @ (y - before)))


def _draw(filters: Filters, path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, TRUTH, figure_with

    run, read = filters.run, filters.read
    with figure_with(path, 2, 2, (9.0, 6.0)) as (_, ((saw, product), (gain, loss))):
        _draw_saw(saw, run)
        _draw_product(product, filters)
        steps = np.flatnonzero(read)
        gain.plot(run.time[steps], kalman_gains(read)[steps], color=TRUTH, lw=1.0, label='theory')
        measured = [_gain(filters, step) for step in steps[1:]]
        gain.plot(run.time[steps[1:]], measured, 'o', color=ESTIMATE, ms=4, label='measured')
        gain.axhline(_steady_gain(), color=INPUT, lw=1.0, ls='--', label='steady state')
        gain.set(title='The gain of each reading', ylabel='gain', xlabel='time [s]',
                 ylim=(0.0, 1.05))  # fmt: skip
        gain.legend(loc='upper right')
        for label, estimate, gains, colour in (
            ('steady gain', filters.steady, _steady_gains(read), INPUT),
            ('Kalman', run.estimate, kalman_gains(read), ESTIMATE),
        ):
            loss.semilogy(run.time, variances(gains), color=colour, lw=1.2, label=label)
            squares = (run.truth - estimate)[::EVERY] ** 2
            error = 2.0 * squares.std(axis=1, ddof=1) / np.sqrt(LEVELS)
            loss.errorbar(run.time[::EVERY], squares.mean(axis=1), error, fmt='.', color=colour,
                          ms=5, elinewidth=0.7)  # fmt: skip
        loss.set(title='Mean square error (dots: 40 levels, 2 standard errors)', ylabel='variance',
                 xlabel='time [s]')  # fmt: skip
        loss.legend(loc='upper right')


def _draw_saw(axis: Any, run: Trajectory) -> None:
    from kalman_ros.report.style import ESTIMATE, READING

    start = run.time <= START
    time = np.repeat(run.time[start], 2)[1:]
    P = run.covariance[start, 0, 0]
    axis.plot(time, np.stack((P, np.append(P[:-1] + Q, 0.0)), axis=1).ravel()[:-1],
              color=ESTIMATE)  # fmt: skip
    axis.axhline(R, color=READING, lw=1.0, ls='--', label='R of a reading')
    axis.set(title='P grows, and shrinks at a reading', ylabel='variance', xlabel='time [s]',
             ylim=(0.0, 1.2))  # fmt: skip
    axis.legend(loc='upper right')


def _draw_product(axis: Any, filters: Filters) -> None:
    """Draw belief, reading and their product at the second reading, of the first level."""
    from kalman_ros.report.style import ESTIMATE, INPUT, READING, TRUTH

    run, step = filters.run, int(np.flatnonzero(filters.read)[1])
    y = float(run.readings['reading'].values[1, 0])
    P = float(run.covariance[step - 1, 0, 0])
    centre = float(run.estimate[step, 0])
    x = np.linspace(centre - 4.0, centre + 4.0, 300)
    for label, mean, variance, colour in (
        ('predicted', float(run.estimate[step - 1, 0]), P + Q, INPUT),
        ('reading', y, R, READING),
        ('product', centre, float(run.covariance[step, 0, 0]), ESTIMATE),
    ):
        density = np.exp(-0.5 * (x - mean) ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)
        axis.plot(x, density, color=colour, label=label)
    axis.axvline(run.truth[step, 0], color=TRUTH, lw=0.8, ls=':', label='truth')
    axis.set(title='A reading at 0.5 s', ylabel='density', xlabel='the level')
    axis.legend(loc='upper right', fontsize=8)
