# SPDX-License-Identifier: Apache-2.0
"""The likelihood of innovations under other noise, many candidates at once.

The filter is linearised where its pass was: with its predictions x and posteriors x + K nu as the
path, another filter's deviation d from it follows

    d <- F d,  nu' = nu - H d,  d <- d + K' nu' - K nu,

with a separate Riccati recursion for K'. So all candidates share one walk over the events.

A variance of the process changes its share of each step's Q, integrated over the step as Q was.
What is taken away is at most all of Q: a change to first order in the step alone would leave a Q
that is indefinite, and a likelihood that no filter has.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from kalman_ros.core import Array
from kalman_ros.linear.batched import corrected, gain, joseph, sandwich, times, weighed

from .passage import Event, Passage

#: Candidates are compared on the last N events.
MOST = 1200


def misfits(
    found: Passage,
    labels: Sequence[tuple[str, ...]],
    candidates: Array,
    densities: Mapping[str, Array],
    most: int = MOST,
) -> Array:
    """Return the misfit of each candidate (C,), as the sum over all events.

    Parameters
    ----------
    found
        The pass of the filter as it is.
    labels
        (sensor, coordinate) or (parameter,), one a variance.
    candidates
        Logarithms of factors of these variances (C, p).
    densities
        By parameter, the spectral density (n, n) that it adds now.
    most
        Candidates are compared on the last N events.
    """
    events = found.events[-most:]
    varied = [index for index, label in enumerate(labels) if len(label) == 1]
    factors = np.exp(candidates[:, varied])
    more, less = shares(events, np.array([densities[labels[i][0]] for i in varied]))
    walk = _Walk(events[0].P, labels, candidates)
    for event, added, removed in zip(events, more, less):
        Q = event.Q + np.tensordot(np.maximum(factors - 1.0, 0.0), added, axes=1)
        walk.take(event, Q - np.tensordot(np.maximum(1.0 - factors, 0.0), removed, axes=1))
    return walk.misfit * (len(found.events) / len(events))


def shares(events: Sequence[Event], densities: Array) -> tuple[Array, Array]:
    """Return what each spectral density adds to the Q of each step, and what is left without.

    Parameters
    ----------
    events
        The steps that led to them.
    densities
        Of the noise that may change (q, n, n).

    Returns
    -------
    more, less
        (E, q, n, n): the integral of exp(A s) W exp(A s)' over the step by Simpson's rule, and
        the part of Q that goes with it, Q - less being semidefinite.
    """
    F, Q = (np.array([getattr(event, name) for event in events])[:, None] for name in 'FQ')
    dt = np.array([event.dt for event in events])[:, None, None, None]
    W = densities.reshape(1, -1, *Q.shape[2:])
    middle = 0.5 * (F + np.eye(F.shape[-1]))
    begin_and_end = W + F @ W @ F.swapaxes(-1, -2)
    more = dt / 6.0 * (begin_and_end + 4.0 * middle @ W @ middle.swapaxes(-1, -2))
    values, vectors = np.linalg.eigh(Q - more)
    rest = (vectors * np.maximum(values, 0.0)[..., None, :]) @ vectors.swapaxes(-1, -2)
    return more, Q - rest


class _Walk:
    """All candidates on their way through the events."""

    def __init__(
        self,
        P: Array,
        labels: Sequence[tuple[str, ...]],
        candidates: Array,
    ) -> None:
        C, n = len(candidates), len(P)
        self.misfit = np.zeros(C)
        self._P, self._d = np.broadcast_to(P, (C, n, n)).copy(), np.zeros((C, n))
        self._labels, self._candidates = labels, candidates
        self._scales: dict[str, Array] = {}
        self._begun = False

    def take(self, event: Event, Q: Array) -> None:
        """Go on to an event with the process noise of each candidate (C, n, n)."""
        H, K_0 = event.H, event.K
        if self._begun:
            self._P, self._d = sandwich(event.F, self._P, Q), times(event.F, self._d)
        self._begun = True
        scale = self._scale(event)
        R = (event.S - H @ event.P @ H.T) * scale[:, :, None] * scale[:, None, :]
        K, S = gain(self._P, H, R)
        nu = event.innovation - times(H, self._d)
        self.misfit += weighed(S, nu) + np.linalg.slogdet(2.0 * np.pi * S)[1]
        self._d = corrected(self._d, K, nu) - K_0 @ event.innovation
        self._P = joseph(K, H, self._P, R)

    def _scale(self, event: Event) -> Array:
        """Return by what the standard deviations of a sensor's coordinates grow (C, k)."""
        if event.sensor not in self._scales:
            scale = np.ones((len(self._candidates), len(event.S)))
            for index, label in enumerate(self._labels):
                if len(label) == 2 and label[0] == event.sensor:
                    scale[:, int(label[1])] = np.exp(0.5 * self._candidates[:, index])
            self._scales[event.sensor] = scale
        return self._scales[event.sensor]
