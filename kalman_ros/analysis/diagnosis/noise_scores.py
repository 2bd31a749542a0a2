# SPDX-License-Identifier: Apache-2.0
"""Derivatives of the likelihood of innovations by the noise that a filter assumes.

If Q and R change by dQ and dR, the covariances of a Kalman filter change to first order by

    dP' = F dP F' + dQ,  dS = H dP' H' + dR,  dK = (dP' H' - K dS) S^-1,
    dP = (I - K H) dP' (I - K H)' + K dR K',

and the innovations, which depend on the gain, change by dnu. The derivative of the log likelihood
and its Fisher information follow in one pass (N. Gupta and R. Mehra, Computational Aspects of
Maximum Likelihood Estimation and Reduction in Sensitivity Function Calculations, IEEE Trans.
Automatic Control 19(6), 1974). The derivatives are by logarithms of variances: a change of 0.1 is
an increase by a tenth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array

from .passage import Event, Passage


@dataclass(frozen=True)
class NoiseScores:
    """The derivative of the log likelihood by logarithms of variances, and its information.

    Parameters
    ----------
    labels
        Label of each variance, (sensor, coordinate) or (parameter,).
    gradient, information
        Derivative (p,) and Fisher information (p, p).
    """

    labels: Sequence[tuple[str, ...]]
    gradient: Array
    information: Array


def noise_scores(
    passage: Passage, noise: Mapping[str, Array], densities: Mapping[str, Array], most: int = 2000
) -> NoiseScores:
    """Return the scores of the variances of all coordinates and of all process noise.

    Parameters
    ----------
    passage
        Filter pass.
    noise
        Variances (k,) of the coordinates, by sensor; those of others are kept.
    densities
        Spectral density (n, n) of the process noise, by parameter.
    most
        Number of last events that count.
    """
    labels: list[tuple[str, ...]] = [
        (name, str(i)) for name, R in noise.items() for i in range(len(R))
    ]
    labels += [(name,) for name in densities]
    p, n = len(labels), len(passage.events[0].x)
    rates = np.zeros((p, n, n))
    for index, density in enumerate(densities.values()):
        rates[p - len(densities) + index] = density
    sensitivity = _Sensitivity(labels, noise, rates)
    for event, e in zip(passage.events[-most:], passage.whitened[-most:]):
        sensitivity.take(event, e)
    return NoiseScores(labels, sensitivity.gradient, sensitivity.information)


class _Sensitivity:
    """The derivatives of covariance and state, which are propagated through time."""

    def __init__(
        self, labels: Sequence[tuple[str, ...]], noise: Mapping[str, Array], rates: Array
    ) -> None:
        p, n = rates.shape[:2]
        self._rates, self._dP, self._dx = rates, np.zeros((p, n, n)), np.zeros((n, p))
        self.gradient, self.information = np.zeros(p), np.zeros((p, p))
        self._dR = {}
        for name, R in noise.items():
            dR = np.zeros((p, len(R), len(R)))
            for index, label in enumerate(labels):
                if label[0] == name and len(label) == 2:
                    dR[index, int(label[1]), int(label[1])] = R[int(label[1])]
            self._dR[name] = dR

    def take(self, event: Event, e: Array) -> None:
        """Propagate to an event and add the terms of its innovation."""
        F, H, K = event.F, event.H, event.K
        dR = self._dR.get(event.sensor, np.zeros((1, len(H), len(H))))
        dP = F @ self._dP @ F.T
        if event.dt > 0.0:
            dP += event.dt * self._rates
        dx = F @ self._dx
        PH = dP @ H.T
        dS = H @ PH + dR
        L = event.white
        white_dS = L @ dS @ L.T
        dnu = -H @ dx
        white_dnu = L @ dnu
        self.gradient += 0.5 * (
            np.einsum('i,pij,j->p', e, white_dS, e) - np.trace(white_dS, axis1=1, axis2=2)
        )
        self.gradient -= e @ white_dnu
        rows = white_dS.reshape(len(white_dS), -1)
        self.information += 0.5 * rows @ rows.T + white_dnu.T @ white_dnu
        Sinv = L.T @ L
        dK = (PH - K @ dS) @ Sinv
        A = np.eye(len(F)) - K @ H
        self._dP = A @ dP @ A.T + K @ dR @ K.T
        self._dx = dx + K @ dnu + (dK @ event.innovation).T
