# SPDX-License-Identifier: Apache-2.0
"""Measurement of a state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from typing import NamedTuple, TypeVar

from kalman_ros.linear.matrices import Array

from .gaussian import Gaussian
from .model import numerical_jacobian
from .space import Space

S = TypeVar('S', bound='Sensor')


class Hypotheses(NamedTuple):
    """Correction of a belief for which one linearisation is too coarse.

    Parameters
    ----------
    log_weights, parts
        The belief times the likelihood of the reading, as a weighted sum of Gaussians: the
        weights (p,), whose sum is the density of the reading, and the Gaussians.
    shares, forecast
        Prediction of the reading by the belief, without noise: weights (q,) of sum 1 and points
        (q, k).
    """

    log_weights: Array
    parts: Sequence[Gaussian]
    shares: Array
    forecast: Array


class Sensor(ABC):
    """A reading y = measure(x) + v, with v ~ N(0, covariance).

    A subclass sets ``output`` and ``covariance`` (k, k) and defines `measure`. Arrays may have
    any leading axes: x (..., n). A measured rotation is Exp(v) measure(x).

    Examples
    --------
    >>> import numpy as np
    >>> import kalman_ros as kr
    >>> class Range(kr.Sensor):
    ...     output = kr.Space(('range',), ('m',))
    ...     covariance = np.array([[0.01]])
    ...
    ...     def measure(self, x):
    ...         return np.hypot(x[..., :1], x[..., 1:2])
    >>> Range().jacobian(np.array([3.0, 4.0])).round(3)
    array([[0.6, 0.8]])
    """

    output: Space
    covariance: Array
    #: Space of the state, which matters to the default Jacobian where it has rotations.
    state: Space = Space(())
    #: Whether the Jacobian is the same everywhere.
    linear: bool = False
    #: Name in the scenario.
    name: str = ''

    def __repr__(self) -> str:
        name, kind = f' {self.name!r}' if self.name else '', type(self).__name__
        return f'{kind}{name}(reads: {self.output}; covariance: {self.covariance.tolist()})'

    @abstractmethod
    def measure(self, x: Array) -> Array:
        """Return the noise-free reading (..., k)."""

    def jacobian(self, x: Array) -> Array:
        """Return d measure / d x (k, n) at ``x`` (n,); numerical by default."""
        return numerical_jacobian(self.measure, x, self.output.subtract, self.state)

    def hypotheses(self, belief: Gaussian, y: Array, count: int) -> Hypotheses | None:
        """Return the belief corrected by ``y`` (k,) as up to ``count`` Gaussians.

        A sensor to which many states look alike divides here a belief that is too wide for one
        linearisation. None, the default, means that the belief is not too wide.
        """
        return None

    def of(self: S, state: Space) -> S:
        """Return the sensor as one of a ``state``, which its default Jacobian may take.

        It is the same sensor where it has the space of its state, or does not need it.
        """
        if self.state.size or not state.rotations:
            return self
        other = copy(self)
        other.state = state
        return other

    def with_covariance(self: S, covariance: Array) -> S:
        """Return the same sensor with another noise ``covariance`` (k, k), not checked."""
        other = copy(self)
        other.covariance = covariance
        return other
