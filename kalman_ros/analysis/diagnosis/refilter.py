# SPDX-License-Identifier: Apache-2.0
"""Likelihood of innovations for many candidates of the noise at once.

The filter is linearised along the path of its pass, with predictions x and posteriors x + K nu.
The deviation d of another filter from this path follows

    d <- F d,  nu' = nu - H d,  d <- d + K' nu' - K nu,

with a separate Riccati recursion for K'. All candidates share one pass over the events.

A variance of the process changes its share of the Q of each step, which is integrated over the
step as Q is. A reduction leaves Q semidefinite: a change to first order in the step would leave an
indefinite Q, and a likelihood that no filter has.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from kalman_ros.core import Array
from kalman_ros.linear.batched import (
    corrected,
    gain,
    product,
    product_transposed,
    sandwich,
    symmetric,
    times,
    weighed,
)

from .passage import Event, Passage

#: Number of last events on which candidates are compared.
MOST = 1200


def misfits(
    passage: Passage,
    labels: Sequence[tuple[str, ...]],
    candidates: Array,
    densities: Mapping[str, Array],
    most: int = MOST,
) -> Array:
    """Return the misfit of each candidate (C,), scaled to all events.

    Parameters
    ----------
    passage
        Pass of the filter with the configured noise.
    labels
        Label of each variance, (sensor, coordinate) or (parameter,).
    candidates
        Logarithms of factors of these variances (C, p).
    densities
        Spectral density (n, n) of the configured process noise, by parameter.
    most
        Number of last events on which candidates are compared.
    """
    events = passage.events[-most:]
    varied = [index for index, label in enumerate(labels) if len(label) == 1]
    factors = np.exp(candidates[:, varied])
    more, less = shares(events, np.array([densities[labels[i][0]] for i in varied]))
    filters = _CandidateFilters(events[0].P, labels, candidates)
    for event, added, removed in zip(events, more, less):
        Q = event.Q + np.tensordot(np.maximum(factors - 1.0, 0.0), added, axes=1)
        filters.take(event, Q - np.tensordot(np.maximum(1.0 - factors, 0.0), removed, axes=1))
    return filters.misfit * (len(passage.events) / len(events))


def shares(events: Sequence[Event], densities: Array) -> tuple[Array, Array]:
    """Return the share of each spectral density in the Q of each step, and its removable part.

    Parameters
    ----------
    events
        Events, each with the step that led to it.
    densities
        Spectral densities of the noise that may change (q, n, n).

    Returns
    -------
    more, less
        Integral of exp(A s) W exp(A s)' over the step by Simpson's rule (E, q, n, n), and the
        part of Q that vanishes without the noise (E, q, n, n), such that Q - less is semidefinite.
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


class _CandidateFilters:
    """The filters of all candidates, which are propagated through the events together."""

    def __init__(self, P: Array, labels: Sequence[tuple[str, ...]], candidates: Array) -> None:
        C, n = len(candidates), len(P)
        self.misfit = np.zeros(C)
        self._P, self._d = np.broadcast_to(P, (C, n, n)).copy(), np.zeros((C, n))
        self._labels, self._candidates = labels, candidates
        self._scales: dict[str, Array] = {}
        self._started = False

    def take(self, event: Event, Q: Array) -> None:
        """Propagate to an event with the Q of each candidate (C, n, n), and correct."""
        H, K_0 = event.H, event.K
        if self._started:
            self._P, self._d = sandwich(event.F, self._P, Q), times(event.F, self._d)
        self._started = True
        scale = self._scale(event)
        R = event.R * scale[:, :, None] * scale[:, None, :]
        K, S = gain(self._P, H, R)
        nu = event.innovation - times(H, self._d)
        self.misfit += weighed(S, nu) + np.linalg.slogdet(2.0 * np.pi * S)[1]
        self._d = corrected(self._d, K, nu) - K_0 @ event.innovation
        self._P = symmetric(self._P - product_transposed(product(K, S), K))

    def _scale(self, event: Event) -> Array:
        """Return the factors of the standard deviations of a sensor's coordinates (C, k)."""
        if event.sensor not in self._scales:
            scale = np.ones((len(self._candidates), len(event.S)))
            for index, label in enumerate(self._labels):
                if len(label) == 2 and label[0] == event.sensor:
                    scale[:, int(label[1])] = np.exp(0.5 * self._candidates[:, index])
            self._scales[event.sensor] = scale
        return self._scales[event.sensor]
