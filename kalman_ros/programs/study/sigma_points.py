# SPDX-License-Identifier: Apache-2.0
"""Sigma points follow a bent relation where its tangent does not.

A target at a known range and an uncertain bearing: its place is a bent cloud. The mean and the
covariance predicted by the extended and by the unscented filter are compared with those of the
cloud, which have a closed form. No loop, so no nodes: these are the filters that the nodes run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kalman_ros.analysis.checks import Check
from kalman_ros.core import Array, Gaussian, LinearSystem, Sensor, Space
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.estimators.filters.ukf import UnscentedKalmanFilter

from . import Findings, between, close
from .stationary import SIGMAS

#: Range and bearing (S. Julier and J. Uhlmann, Unscented Filtering and Nonlinear Estimation,
#: Proc. IEEE 92(3), 2004, section II.C, with other units).
MEAN = np.array([1.0, 0.5 * np.pi])
STD = np.array([0.02, np.radians(15.0)])
BELIEF = Gaussian(MEAN, np.diag(STD**2))
POLAR = Space(('r', 'theta'), ('m', 'rad'), angles=('theta',))
STILL = LinearSystem(np.zeros((2, 2)), np.zeros((2, 0)), np.zeros(2), POLAR, Space((), ()))
#: Standard deviation of the place as a reading, which is negligible.
NOISE = 1e-9
CLOUD = 200_000


class Place(Sensor):
    """Sensor of the place x = r cos(theta), y = r sin(theta)."""

    output = Space(('x', 'y'), ('m', 'm'))
    covariance = NOISE**2 * np.eye(2)

    def measure(self, x: Array) -> Array:
        """Return the place."""
        r, theta = np.moveaxis(x, -1, 0)
        return np.stack((r * np.cos(theta), r * np.sin(theta)), axis=-1)


def exact(belief: Gaussian) -> Gaussian:
    """Return mean and covariance of the place, by E exp(j theta) = exp(j mean - variance / 2)."""
    (r, theta), (r_2, s_2) = belief.mean, belief.covariance.diagonal()
    mean = r * np.exp(-0.5 * s_2) * np.array([np.cos(theta), np.sin(theta)])
    square, twice = r**2 + r_2, np.exp(-2.0 * s_2)
    c, s = np.cos(2.0 * theta), np.sin(2.0 * theta)
    second = 0.5 * square * (np.eye(2) + twice * np.array([[c, s], [s, -c]]))
    return Gaussian(mean, second - np.outer(mean, mean))


@dataclass(frozen=True)
class Guess:
    """Prediction of the place by a filter: the filter's name, and the Gaussian."""

    name: str
    place: Gaussian


def study(size: float = 1.0) -> Findings:
    """Draw a cloud of 200,000 points, or fewer, through the relation."""
    rng = np.random.default_rng(1)
    cloud = Place().measure(rng.multivariate_normal(*BELIEF, size=round(CLOUD * size)))
    guesses = predictions(BELIEF)
    checks = [*_cloud_checks(cloud), *_guess_checks(guesses)]
    return Findings(checks, lambda path: _draw(cloud, guesses, path))


def predictions(belief: Gaussian) -> list[Guess]:
    """Return the place by each filter: the prediction of a reading y is y less its innovation."""
    guesses = []
    for name, filter in (
        ('EKF', ExtendedKalmanFilter(STILL)),
        ('UKF', UnscentedKalmanFilter(STILL)),
    ):
        update = filter.correct(belief, np.zeros(2), Place())
        guesses.append(Guess(name, Gaussian(-update.innovation, update.innovation_covariance)))
    return guesses


def _cloud_checks(cloud: Array) -> list[Check]:
    """Compare the cloud with the closed form."""
    known, n = exact(BELIEF), len(cloud)
    deviation = known.std / np.sqrt(n)
    x, y = cloud.mean(axis=0)
    # the scatter of a squared deviation is measured, since y is far from normal
    squares = (cloud[:, 1] - known.mean[1]) ** 2
    scatter = SIGMAS * float(squares.std() / np.sqrt(n))
    return [
        close('cloud: mean of x', 'm', known.mean[0], x, SIGMAS * deviation[0]),
        close('cloud: mean of y', 'm', known.mean[1], y, SIGMAS * deviation[1]),
        close('cloud: variance of y', 'm^2', known.covariance[1, 1], squares.mean(), scatter),
    ]


def _guess_checks(guesses: Sequence[Guess]) -> list[Check]:
    """Compare the filters with their formulas, and with the closed form."""
    known, s = exact(BELIEF), STD[1]
    # the tangent of an arc has the height of its top; of five points two are sqrt(3) sigma aside
    tops = {'EKF': 1.0, 'UKF': (2.0 + np.cos(np.sqrt(3.0) * s)) / 3.0}
    # shares of the true sigma: the extended filter sees the range alone
    shares = {'EKF': (STD[0] / known.std[1], 1e-6), 'UKF': (1.0, 0.05)}
    checks = []
    for name, place in ((guess.name, guess.place) for guess in guesses):
        ratio = float(place.std[1] / known.std[1])
        checks += [
            close(f'{name}: mean of y', 'm', tops[name], float(place.mean[1]), 1e-9),
            close(f'{name}: claimed sigma of y / true', '', shares[name][0], ratio,
                  shares[name][1]),
        ]  # fmt: skip
    off = [abs(guess.place.mean[1] - known.mean[1]) / known.std[1] for guess in guesses]
    return [*checks, between('error of the mean of y, UKF / EKF', '', 0.0, off[1] / off[0], 1e-3)]


def _draw(cloud: Array, guesses: Sequence[Guess], path: Path) -> None:
    from kalman_ros.report.ellipse import outline
    from kalman_ros.report.style import ESTIMATE, INPUT, READING, TRUTH, figure_with

    colours = {'EKF': INPUT, 'UKF': ESTIMATE}
    spreads = np.radians(np.linspace(1.0, 40.0, 40))
    beliefs = [Gaussian(MEAN, np.diag([STD[0] ** 2, s**2])) for s in spreads]
    with figure_with(path, 1, 3, (11.0, 3.4)) as (_, ((places, means, sigmas),)):
        places.plot(*cloud[:3000].T, '.', ms=1.0, color=READING, label='cloud')
        for name, place, style in (
            ('true moments', exact(BELIEF), TRUTH),
            *((guess.name, guess.place, colours[guess.name]) for guess in guesses),
        ):
            places.plot(*outline(*place, 2.0).T, color=style, lw=1.4, label=f'{name}, 2 sigma')
            places.plot(*place.mean, '+', color=style, ms=9)
        filter = UnscentedKalmanFilter(STILL)
        points = MEAN + (STD[:, np.newaxis] * filter.directions).T
        places.plot(*Place().measure(points).T, 'o', mfc='none', color=ESTIMATE, ms=5,
                    label='sigma points')  # fmt: skip
        places.set(title='A range and an uncertain bearing', xlabel='x [m]', ylabel='y [m]')
        places.legend(loc='lower center', fontsize=7)
        pairs = [(exact(belief), predictions(belief)) for belief in beliefs]
        known = np.array([[moments.mean[1], moments.std[1]] for moments, _ in pairs])
        for index, axis in enumerate((means, sigmas)):
            axis.plot(np.degrees(spreads), known[:, index], color=TRUTH, lw=2.4, label='true')
            for k, name in enumerate(colours):
                values = [(p[k].place.mean[1], p[k].place.std[1])[index] for _, p in pairs]
                axis.plot(np.degrees(spreads), values, '--', color=colours[name], label=name)
            axis.axvline(np.degrees(STD[1]), color=READING, lw=0.8, ls=':')
            axis.set_xlabel('sigma of the bearing [deg]')
            axis.legend(loc='lower left' if index == 0 else 'upper left')
        means.set(title='Mean of y ...', ylabel='mean of y [m]')
        sigmas.set(title='... and its sigma', ylabel='sigma of y [m]')
