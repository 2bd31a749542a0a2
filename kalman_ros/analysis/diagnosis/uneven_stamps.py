# SPDX-License-Identifier: Apache-2.0
"""Sensors whose stamps are wrong by another time for each reading.

A reading that is stamped a time t after it was taken is off by t dh/dt to first order. If t is
random with a variance of tau^2, the reading has the noise R + tau^2 v v', v = dh/dt along the
predictions: errors that grow with the rate, where wrong noise is as large at rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from kalman_ros.core import Array

from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Curve, Figure, Finding
from .hypotheses import reading_rates
from .peak import deviation, peak

#: Fewest readings of the sensor.
_FEWEST = 50
#: Times that are more alike from one reading to the next than this have another cause.
_ALIKE = 0.2
#: Least standard deviation (s), and the trial ones as shares of the mean interval of the readings.
_LEAST, _TRIALS = 0.001, np.geomspace(0.01, 10.0, 13)


def find(case: Examination) -> Iterator[Finding]:
    """Yield the sensors whose errors grow with the rate of their readings."""
    for name in case.judged:
        count = len(case.passage.of(name))
        if count < _FEWEST:
            continue
        e, spread = _directions(case, name)

        def gain(tau: float, e: Array = e, spread: Array = spread) -> float:
            """Return twice the logarithm of the likelihood ratio of a deviation ``tau`` in s."""
            grown = 1.0 + tau**2 * spread
            return float(np.sum(tau**2 * e**2 / grown - np.log(grown)))

        trials = _TRIALS * case.evidence.duration / count
        best = int(np.argmax([gain(tau) for tau in trials]))
        bounds = trials[np.clip([best - 1, best, best + 1], 0, len(trials) - 1)]
        if not trials[best] > _LEAST or len(set(bounds.tolist())) < 3:
            continue
        near = peak(gain, *bounds.tolist())
        alike = _likeness(e, spread, near[1])
        if near[1] > _LEAST and gain(near[1]) > CHANCE and alike < _ALIKE:
            std = min(deviation(gain, *near), near[1])
            yield _finding(case, name, near[1], std, gain(near[1]))


def _directions(case: Examination, name: str) -> tuple[Array, Array]:
    """Return v' S^-1 nu and v' S^-1 v of each reading of a sensor (N,), v its rate."""
    v = reading_rates(case.evidence, case.passage, name)
    white = np.einsum('eij,ej->ei', case.passage.series('white', name), v)
    e = case.passage.whitened_of(name)
    return np.einsum('ei,ei->e', white, e), np.einsum('ei,ei->e', white, white)


def _likeness(e: Array, spread: Array, tau: float) -> float:
    """Return how far times are alike from one reading to the next, about their mean."""
    mean = e.sum() / spread.sum()
    times = (e - mean * spread) / np.sqrt(np.maximum(spread * (1.0 + tau**2 * spread), 1e-300))
    return float(np.mean(times[1:] * times[:-1]) / np.mean(times**2))


def _finding(case: Examination, name: str, tau: float, std: float, gain: float) -> Finding:
    """Return the finding that stamps of a sensor are wrong by ``tau`` seconds at random."""

    def mended() -> Evidence:
        """Return the evidence with as much more noise as the stamps cause."""
        v = reading_rates(case.evidence, case.passage, name)
        rows, record = case.passage.series('index', name), case.evidence.sensors[name]
        covariance = record.covariance.copy()
        covariance[rows] += tau**2 * v[:, :, None] * v[:, None, :]
        return case.evidence.with_sensor(name, replace(record, covariance=covariance))

    return Finding(
        'stamps uneven', name,
        f'stamps of {name} are wrong by {tau:.3g} ± {std:.1g} s, by another time for each '
        'reading: they are stamped when a busy computer gets to them, not when they are taken. '
        'Stamp them in the driver or by the clock of the sensor, or declare more noise.',
        gain**0.5, gain=gain, figure=_picture(case, name), mended=mended,
    )  # fmt: skip


def _picture(case: Examination, name: str) -> Figure:
    """Return the innovations of the coordinate that shows it most, by its rate."""
    v, nu = (
        reading_rates(case.evidence, case.passage, name),
        case.passage.series('innovation', name),
    )
    std = np.sqrt(case.passage.series('S', name).diagonal(axis1=1, axis2=2))
    index = int(np.argmax(np.mean((v / std) ** 2, axis=0)))
    label = case.evidence.scenario.sensors[name].sensor.output.names[index]
    curve = Curve('a reading', v[:, index], nu[:, index], 'dots')
    return Figure(f'{name}: errors by rate', f'{label}, a second', 'innovation', (curve,))
