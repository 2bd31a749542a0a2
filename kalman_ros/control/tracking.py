# SPDX-License-Identifier: Apache-2.0
"""Reference tracking: the equilibrium of a reference, which the regulator then holds.

With (x_e, u_e) at rest, A x_e + B u_e = 0, the law u = u_e - K (x - x_e) has the loop of the
regulator about x_e (Anderson and Moore, Optimal Control, 1990, section 4.4). Rest does not
depend on sampling, so a sampled loop has the same equilibrium.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, ArrayLike, LinearSystem, vector

#: A singular value this small, relative to the largest, counts as zero.
_RANK_TOLERANCE = 1e-12
#: A reference that is missed by less than this, relative to its size, is reached.
_REACHED = 1e-9


@dataclass(frozen=True)
class Equilibrium:
    """A state (n,) and the input (m,) that holds it there."""

    state: Array
    input: Array


@dataclass(frozen=True)
class FeedForward:
    """The equilibrium of a reference r (k,), which is linear in it.

    Parameters
    ----------
    coordinates
        The states that r sets; the others follow.
    state_gain, input_gain
        x_e = state_gain r (n, k), u_e = input_gain r (m, k).
    selected
        The indices of the coordinates in x (k,).
    """

    coordinates: tuple[str, ...]
    state_gain: Array
    input_gain: Array
    selected: tuple[int, ...]

    def nearest(self, reference: ArrayLike) -> Equilibrium:
        """Return the equilibrium with the least sum of squared differences from a reference.

        If several are equally near, it is the one with the least state and input, where a unit of
        input is scaled by the norms of B and A.

        Raises
        ------
        ValueError
            If the reference has the wrong size.
        """
        r = vector('reference', reference, len(self.coordinates))
        return Equilibrium(self.state_gain @ r, self.input_gain @ r)

    def equilibrium(self, reference: ArrayLike, rest: ArrayLike | None = None) -> Equilibrium:
        """Return the equilibrium that is exactly at a reference.

        Parameters
        ----------
        reference
            As its difference from ``rest`` (k,).
        rest
            The coordinates at rest (k,), for the message of an error; zero by default.

        Raises
        ------
        ValueError
            If there is none; the message names the coordinates that cannot be reached.
        """
        equilibrium = self.nearest(reference)
        r = vector('reference', reference, len(self.coordinates))
        at = equilibrium.state[list(self.selected)]
        missed = np.abs(at - r) > _REACHED * max(float(np.abs(r).max(initial=0.0)), 1e-300)
        if missed.any():
            about = np.zeros(len(r)) if rest is None else vector('rest', rest, len(r))
            at = np.where(np.abs(at) > _REACHED * np.abs(r).max(), at, 0.0)
            listed = ', '.join(
                f'{name} = {wanted:.4g} (nearest {near:.4g})'
                for name, wanted, near, there in zip(
                    self.coordinates, about + r, about + at, missed
                )
                if there
            )
            raise ValueError(f'reference: no input holds the system at {listed}')
        return equilibrium


def feed_forward(system: LinearSystem, coordinates: Sequence[str] | None = None) -> FeedForward:
    """Return the equilibria of references for some ``coordinates`` of the state, or for all.

    The equilibria (x_e, u_e) are the null space of [A, B]; r is projected on it.

    Raises
    ------
    ValueError
        If a name is unknown.
    """
    names = system.state.names if coordinates is None else tuple(coordinates)
    selected = system.state.indices(names, 'coordinates')
    n = len(system.A)
    rest, scale = _equilibria(system)
    # the least z of those with rest z nearest to r, and (x_e, u_e / scale) = rest z
    gain = rest @ np.linalg.pinv(rest[selected], rcond=_RANK_TOLERANCE)
    return FeedForward(names, gain[:n], gain[n:] * scale, tuple(selected))


def resting_directions(system: LinearSystem, held: Sequence[int]) -> tuple[Array, Array] | None:
    """Return changes of states and inputs, (n, r) and (m, r), between which it rests everywhere.

    The coordinates with the indices ``held`` do not change; None if then no other does.
    """
    n = len(system.A)
    rest, scale = _equilibria(system)
    free = rest @ _null_space(rest[list(held)])
    states, inputs = free[:n], free[n:] * scale
    moved = np.linalg.norm(states, axis=0) > _REACHED
    return (states[:, moved], inputs[:, moved]) if moved.any() else None


def _equilibria(system: LinearSystem) -> tuple[Array, float]:
    """Return a basis (n + m, r) of the equilibria (x_e, u_e / scale), and the scale."""
    # without the scale a stiff spring makes every x_e tiny beside its u_e, lost in rounding
    scale = float((np.linalg.norm(system.A) or 1.0) / (np.linalg.norm(system.B) or 1.0))
    return _null_space(np.hstack((system.A, system.B * scale))), scale


def _null_space(matrix: Array) -> Array:
    if not matrix.size:
        return np.eye(matrix.shape[1])
    _, sizes, Vh = np.linalg.svd(matrix)
    rank = int(np.sum(sizes > _RANK_TOLERANCE * sizes[0]))
    return np.asarray(Vh[rank:].T)


def holdable(system: LinearSystem) -> list[str]:
    """Return the states that steady inputs hold at a reference, all at once, in order.

    Of states that depend on each other at rest, or outnumber the inputs, the first are taken.
    """
    names: list[str] = []
    for name in system.state.names:
        candidate = [*names, name]
        gains = feed_forward(system, candidate)
        reached = gains.state_gain[list(gains.selected)]
        if np.allclose(reached, np.eye(len(candidate)), atol=1e-9):
            names = candidate
    return names[: system.input.size]
