# SPDX-License-Identifier: Apache-2.0
"""How a state is seen."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from typing import TypeVar

from kalman_ros.linear.arrays import Array

from .gaussian import Gaussian
from .model import numerical_jacobian
from .space import Space

S = TypeVar('S', bound='Sensor')


class Sensor(ABC):
    """A reading y = measure(x) + v, with v ~ N(0, covariance).

    A subclass sets ``output`` and ``covariance`` (k, k) and writes `measure`. Arrays may have
    any leading axes: x (..., n).
    """

    output: Space
    covariance: Array
    #: Whether its Jacobian is the same everywhere.
    linear: bool = False
    #: What it is called in its scenario.
    name: str = ''

    def __repr__(self) -> str:
        name, kind = f' {self.name!r}' if self.name else '', type(self).__name__
        return f'{kind}{name}(reads: {self.output}; covariance: {self.covariance.tolist()})'

    @abstractmethod
    def measure(self, x: Array) -> Array:
        """Return the noise-free reading (..., k)."""

    def jacobian(self, x: Array) -> Array:
        """Return d measure / d x (k, n) at ``x`` (n,); numerical by default."""
        return numerical_jacobian(self.measure, x, self.output.subtract)

    def hypotheses(
        self, belief: Gaussian, y: Array, count: int
    ) -> Sequence[tuple[float, Gaussian]]:
        """Return what a first reading ``y`` (k,) may mean, if not one thing: weighted beliefs.

        A sensor to which many states look alike says here, with about ``count`` beliefs, which
        those are; each has the reading in it. By default there are none: the belief itself,
        corrected, is good enough.
        """
        return ()

    def with_covariance(self: S, covariance: Array) -> S:
        """Return the same sensor with another noise ``covariance`` (k, k), not checked."""
        other = copy(self)
        other.covariance = covariance
        return other
