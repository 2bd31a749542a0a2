# SPDX-License-Identifier: Apache-2.0
"""A belief about a state."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np

from kalman_ros.linear.matrices import Array, ArrayLike, check_real

from .known_arguments import knows_arguments
from .known_names import KnownNames

#: Entries of a covariance that differ by less than this, relative to the largest, are the same.
_SYMMETRIC = 1e-6

G = TypeVar('G', bound='Gaussian')


class _Moments(NamedTuple):
    mean: Array
    covariance: Array


class Gaussian(KnownNames, _Moments):
    """A normal distribution.

    Parameters
    ----------
    mean
        Its mean (n,).
    covariance
        Its covariance (n, n); a list is its diagonal, and a number that of all.

    Raises
    ------
    ValueError
        If the sizes do not match, or the covariance is not symmetric.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kr.Gaussian([1.0, 2.0], [[4.0, 0.0], [0.0, 9.0]]).std
    array([2., 3.])
    """

    __slots__ = ()
    other_names: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(('x', 'mu'), '.mean'),
        **dict.fromkeys(('P', 'cov', 'Sigma'), '.covariance'),
        **dict.fromkeys(('sigma', 'stddev'), '.std'),
        'var': '.covariance.diagonal()',
    }
    #: L (..., n, n) with L L' = P, where a filter keeps it.
    factor: Array | None = None

    @knows_arguments(x='mean', mu='mean', P='covariance', cov='covariance', Sigma='covariance')
    def __new__(cls: type[G], mean: ArrayLike, covariance: ArrayLike) -> G:
        """Return the belief; lists become arrays."""
        check_real('mean', mean)
        check_real('covariance', covariance)
        x, P = np.asarray(mean, dtype=float), np.asarray(covariance, dtype=float)
        if x.ndim == 0:
            raise ValueError(f'mean: expected a vector, got the number {x}')
        if P.ndim < 2 and x.ndim == 1 and P.shape in ((), x.shape):
            P = np.diag(np.broadcast_to(P, x.shape))
        if P.shape != x.shape + x.shape[-1:]:
            expected = ' x '.join(map(str, x.shape + x.shape[-1:]))
            got = ' x '.join(map(str, P.shape)) or f'the number {P}'
            numbers = f'{x.size} number{"" if x.size == 1 else "s"}'
            raise ValueError(f'covariance: expected {expected} for a mean of {numbers}, got {got}')
        skew = np.abs(P - P.swapaxes(-1, -2)) if np.isfinite(P).all() else np.zeros(1)
        if (skew > _SYMMETRIC * np.abs(P).max(initial=0.0)).any():
            raise ValueError('covariance: expected a symmetric matrix')
        return super().__new__(cls, x, P)

    @property
    def std(self) -> Array:
        """Standard deviation of each coordinate (n,)."""
        return np.sqrt(self.covariance.diagonal())


#: For the inner loops of filters, whose sizes match by construction: a belief from a tuple of
#: mean and covariance, unchecked, in a third of the time.
unchecked: Callable[[tuple[Array, Array]], Gaussian] = partial(tuple.__new__, Gaussian)


class Definite(Gaussian):
    """A belief that is known to be finite and positive definite; one made of it is not."""

    __slots__ = ()

    @classmethod
    def _make(cls, iterable: Iterable[Any]) -> Gaussian:  # type: ignore[override]
        return unchecked(tuple(iterable))


#: A belief that is known to be definite, from a tuple as `unchecked`.
definite: Callable[[tuple[Array, Array]], Gaussian] = partial(tuple.__new__, Definite)


def chosen(mask: Any, a: Gaussian, b: Gaussian) -> Gaussian:
    """Return beliefs ``a`` where a mask (...) is set, and ``b`` elsewhere."""
    x = np.where(mask[..., np.newaxis], a.mean, b.mean)
    return unchecked((x, np.where(mask[..., np.newaxis, np.newaxis], a.covariance, b.covariance)))
