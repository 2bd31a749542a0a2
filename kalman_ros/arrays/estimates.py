# SPDX-License-Identifier: Apache-2.0
"""Estimates from a filter or a smoother, as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, NoReturn

import numpy as np

from kalman_ros.core import Array, Gaussian, Space
from kalman_ros.core.known_names import KnownNames
from kalman_ros.estimators.smoother import Filtered
from kalman_ros.simulation.trajectory import Innovations, Series

from . import text
from .tables import to_dataframe


@dataclass(frozen=True)
class Record:
    """The data for smoothing and drawing.

    The filter, every step, which are shown, and H (k, n) of each sensor that is linear.
    """

    filter: Any
    steps: Sequence[Filtered]
    shown: Sequence[int]
    slopes: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, repr=False)
class Estimates(KnownNames):
    """Beliefs in time.

    Parameters
    ----------
    state
        The space of the state: names, units, angles.
    time
        The given times (N,), unique and in order.
    mean, covariance
        Of the belief at each time (N, n) and (N, n, n): after its readings, or, when smoothed,
        after all readings.
    nis
        By time, the normalised innovation squared of all its readings (N,): chi-square with
        ``degrees`` degrees of freedom for a consistent filter. NaN without readings, and for
        smoothed estimates.
    degrees
        The number of values read at each time (N,).
    innovations
        By sensor: at its times the innovations (N, k), the deviations expected and the NIS.
    readings
        By sensor, as given.
    outputs
        By sensor, the space of its readings.
    counts
        By sensor, the number of readings with each outcome: ``'fused'``, ``'rejected: ...'``.
    log_likelihood
        Of all fused readings.
    filter
        The name of the filter.
    smoothed
        Whether later readings are included.
    arithmetic
        What computed the model and the sensors: C, CasADi or numpy, with the reason.
    record
        What smoothing and pictures need.
    labels
        Of the index that brought the times, by time; empty without one.
    restarts
        How often the filter began again from the initial belief, since it could not go on.
    """

    other_names: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(('x', 'xs', 'x_hat', 'x_post', 'means', 'state_mean'), '.mean'),
        **dict.fromkeys(('P', 'Ps', 'P_post', 'cov', 'covariances'), '.covariance'),
        **dict.fromkeys(('y', 'residual', 'innovation'), ".innovations['name'].values"),
        **dict.fromkeys(('llf', 'loglik', 'log_lik', 'loglikelihood'), '.log_likelihood'),
        **dict.fromkeys(('t', 'times'), '.time'),
        **dict.fromkeys(('K', 'S', 'gain'), 'of a correction: KalmanFilter(model).correct(...)'),
        'std': ".covariance's diagonal, of which it is the root",
    }  # fmt: skip

    state: Space
    time: Array
    mean: Array
    covariance: Array
    nis: Array
    degrees: Array
    innovations: Mapping[str, Innovations]
    readings: Mapping[str, Series]
    outputs: Mapping[str, Space]
    counts: Mapping[str, Mapping[str, int]]
    log_likelihood: float
    filter: str
    record: Record
    smoothed: bool = False
    arithmetic: str = 'numpy'
    labels: Mapping[float, Any] = field(default_factory=dict)
    restarts: int = 0

    @property
    def std(self) -> Array:
        """The standard deviation of each state (N, n)."""
        return np.sqrt(self.covariance.diagonal(axis1=1, axis2=2))

    @property
    def last(self) -> Gaussian:
        """The belief at the last time: where a later call may go on from."""
        return self[-1]

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, index: int) -> Gaussian:
        """Return the belief at one of the times, counted from 0."""
        return Gaussian(self.mean[index], self.covariance[index])

    def __array__(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError('Estimates are no array: take .mean (N, n) or .covariance (N, n, n)')

    def __iter__(self) -> NoReturn:
        raise TypeError('Estimates do not unpack: take .mean (N, n) and .covariance (N, n, n)')

    def __repr__(self) -> str:
        what = f'{"smoothed" if self.smoothed else "filtered"} by {self.filter}'
        n, N = self.state.size, len(self.time)
        span = f'{N} times from {self.time[0]:g} to {self.time[-1]:g} s'
        lines = [f'{n} state{"s" if n > 1 else ""} at {span}, {what}']
        names = [self.state.label(name) for name in self.state.names]
        cells = ([name, self._at(0, i), self._at(-1, i)] for i, name in enumerate(names))
        lines += text.table(['', 'first', 'last'], cells)
        for name, outcomes in self.counts.items():
            counted = ', '.join(f'{count} {what}' for what, count in outcomes.items() if count)
            lines.append(f'readings of {name}: {counted or "none"}')
        if self.restarts:
            lines.append(f'it could not go on, and began again from the start: {self.restarts}')
        if not self.smoothed and self.degrees.sum():
            mean = np.nansum(self.nis) / self.degrees.sum()
            lines.append(f'NIS per number read: {mean:.3g}, where a consistent filter has 1')
            lines.append(f'log-likelihood: {self.log_likelihood:.6g}')
        return '\n'.join(lines)

    def _at(self, k: int, i: int) -> str:
        mean, std = self.mean[k, i].item(), self.covariance[k, i, i].item() ** 0.5
        return f'{text.number(mean)} ± {text.number(std)}'

    def to_dataframe(self) -> Any:
        """Return a DataFrame of pandas: each state, and its deviation as ``NAME std``.

        The index is that of the readings, or the time in seconds.
        """
        labels = [self.labels.get(time, time) for time in self.time.tolist()]
        columns = dict(zip(self.state.names, self.mean.T))
        columns |= {f'{name} std': std for name, std in zip(self.state.names, self.std.T)}
        return to_dataframe(labels, columns)

    def plot(self, path: str | Path | None = None, truth: Array | None = None) -> Any:
        """Draw each state with its band, its readings and, if known, the truth (N, n).

        Returns
        -------
        The axes (n, 1) of a figure of matplotlib, which a notebook shows and ``plt.show()`` opens;
        with a ``path`` the figure is saved there instead, and closed.
        """
        from kalman_ros.report.array_pictures import estimates  # matplotlib is slow to load

        return estimates(self, None if truth is None else np.asarray(truth), _path(path))


def _path(path: str | Path | None) -> Path | None:
    return None if path is None else Path(path)
