# SPDX-License-Identifier: Apache-2.0
"""Fast observers are noisier; Kalman's gain has the least error.

A cart is pushed at random, its position is measured, and observers of several speeds start 100 m
away from it. The decay is fitted to their errors; the noise is the remaining error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.analysis.checks import Check
from kalman_ros.control.identification import fit
from kalman_ros.control.lqe import dlqe
from kalman_ros.core import Array
from kalman_ros.linear.placement import place_observer
from kalman_ros.linear.structure import continuous_poles, eigenvalues

from . import Findings, close
from .stationary import SIGMAS, Stationary, estimation_error
from .study_run import ran
from .systems import CART_READING, cart, plant

#: Observers have their poles at -p and -2 p, for each of these p in 1/s.
SPEEDS = (1.5, 8.0, 3.0)
DT, NOISE = 0.02, 0.1
CART = ([0.0, 0.1], NOISE, 1.0 / DT)
PLANT = plant(cart(*CART))
STEP = PLANT.sampled(DT)
START = np.array([100.0, 0.0])
#: Remaining share of the start when the noise is evaluated.
FORGOTTEN = 1e-6


@dataclass(frozen=True)
class Observer:
    """An observer's gain (2, 1), with its theory and its measured errors (N, 2)."""

    name: str
    gain: Array
    error: Array
    theory: Stationary

    @property
    def pole(self) -> complex:
        """Slowest pole of the error with this gain, in 1/s."""
        poles = continuous_poles(eigenvalues(self.theory.matrix), DT)
        return complex(poles[np.argmax(poles.real)])

    @property
    def settled(self) -> Array:
        """Errors after the start has decayed."""
        return self.error[round(np.log(FORGOTTEN) / self.pole.real / DT) :]


def study(size: float = 1.0) -> Findings:
    """Run the cart for 45 s with each observer."""
    duration = 15.0 + 30.0 * size
    speeds = sorted(SPEEDS[: max(2, round(len(SPEEDS) * size))])
    kalman = _run(
        "Kalman's gain",
        dlqe(STEP.F, CART_READING, STEP.Q, np.array([[NOISE**2]])).gain,
        {'filter': 'steady_state'},
        duration,
    )
    observers = [_placed(speed, duration) for speed in speeds]
    checks = []
    for observer in (kalman, *observers):
        checks += _checks(observer)
    checks += [_excess(observer, kalman) for observer in observers]
    named = dict(zip(speeds, observers))
    return Findings(checks, lambda path: _draw(kalman, named, checks, path))


def _gain(speed: float) -> Array:
    """Return the gain L dt for each reading of a continuous observer."""
    return place_observer(PLANT.A, CART_READING, [-speed, -2.0 * speed]).gain * DT


def _placed(speed: float, duration: float) -> Observer:
    options = {'filter': 'luenberger', 'observer_poles': [-speed, -2.0 * speed]}
    return _run(f'p = {speed:g}', _gain(speed), options, duration)


def _run(name: str, gain: Array, options: Mapping[str, Any], duration: float) -> Observer:
    # the same seed each time: every observer has the same cart and the same readings
    trajectory = ran(
        cart(*CART, initial_state=START.tolist(), enabled=False, **options), seconds=duration
    )
    return Observer(name, gain, trajectory.truth - trajectory.estimate, _theory(gain))


def _theory(gain: Array) -> Stationary:
    return estimation_error(STEP, CART_READING, np.array([[NOISE**2]]), gain)


def _checks(observer: Observer) -> list[Check]:
    """Compare the decay of the start and the remaining errors with theory."""
    fitted = fit(observer.error[:-1], observer.error[1:])
    index = int(np.argmax(np.abs(fitted.poles)))
    pole = continuous_poles(fitted.poles, DT)[index]
    # s = log(z) / DT, so an error of z counts by 1 / (z DT)
    deviations = fitted.pole_deviations(observer.theory.noise) / np.abs(fitted.poles) / DT
    tolerance = SIGMAS * float(deviations[index])
    name, settled, rms = observer.name, observer.settled, observer.theory.rms
    return [
        close(f'decay, {name}', '1/s', observer.pole.real, pole.real, tolerance),
        rms(f'RMS error of x, {name}', 'm', 0, settled[:, 0]),
        rms(f'RMS error of v, {name}', 'm/s', 1, settled[:, 1]),
    ]


def _excess(observer: Observer, kalman: Observer) -> Check:
    """Compare the excess of an observer's mean squared error of x over that of Kalman's gain.

    Both errors have the same noise, so they form one recursion, e and e_K, and the
    difference of their squares scatters less than each.
    """
    count = min(len(observer.settled), len(kalman.settled))
    M = np.zeros((4, 4))
    M[:2, :2], M[2:, 2:] = observer.theory.matrix, kalman.theory.matrix
    through = np.vstack([np.eye(2) - design.gain @ CART_READING for design in (observer, kalman)])
    gains = np.vstack((observer.gain, kalman.gain))
    noise = through @ STEP.Q @ through.T + NOISE**2 * gains @ gains.T
    weight = np.diag([1.0, 0.0, -1.0, 0.0])
    expected = Stationary(M, noise).average(weight, count)
    squares = observer.settled[-count:, 0] ** 2 - kalman.settled[-count:, 0] ** 2
    name = f'x^2 above Kalman, {observer.name}'
    return close(name, 'm^2', expected.mean, float(squares.mean()), SIGMAS * expected.std)


def _draw(
    kalman: Observer, observers: Mapping[float, Observer], checks: Sequence[Check], path: Path
) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, TRUTH, allowed, picture, shades

    speeds = np.geomspace(min(observers) / 1.5, max(observers) * 1.5, 60)
    with picture(path, 1, 2, (8.0, 3.2)) as (_, ((start, noise),)):
        colours = [*shades(len(observers)), INPUT]
        for observer, colour in zip((*observers.values(), kalman), colours):
            time = np.arange(len(observer.error)) * DT
            start.plot(time, np.abs(observer.error[:, 0]), color=colour, label=observer.name)
        start.set_xlim(0.0, 12.0)
        start.set_yscale('log')
        start.set_ylim(1e-3, 200.0)
        start.set_ylabel('error of x [m]')
        start.set_title('Forgetting a wrong start')
        start.legend(loc='upper right')
        spread = [np.sqrt(_theory(_gain(speed)).covariance[0, 0]) for speed in speeds]
        noise.loglog(speeds, spread, color=TRUTH, label='by the Lyapunov equation')
        measured = [
            np.sqrt(np.mean(observer.settled[:, 0] ** 2)) for observer in observers.values()
        ]
        by_name = {check.name: check for check in checks}
        bars = [by_name[f'RMS error of x, {observer.name}'] for observer in observers.values()]
        allowed(noise, observers, bars, ESTIMATE)
        noise.loglog([*observers], measured, 'o', color=ESTIMATE, label='measured, and allowed')
        least = np.sqrt(np.mean(kalman.settled[:, 0] ** 2))
        noise.axhline(least, color=INPUT, label="Kalman's gain, measured")
        noise.set_xticks([*observers], [f'{speed:g}' for speed in observers])
        noise.set_ylim(0.03, 0.25)
        noise.set_yticks([0.03, 0.05, 0.1, 0.2], ['0.03', '0.05', '0.1', '0.2'])
        noise.minorticks_off()
        noise.set_xlabel('p [1/s], with poles at -p and -2 p')
        noise.set_ylabel('RMS error of x [m]')
        noise.set_title('The remaining noise')
        noise.legend(loc='upper right')
