# SPDX-License-Identifier: Apache-2.0
"""Plants, controllers and loops as systems with inputs and outputs, connected as in a diagram."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, ArrayLike, matrix
from kalman_ros.linear.structure import ComplexArray, eigenvalues, is_stable


@dataclass(frozen=True)
class StateSpace:
    """dx/dt = A x + B u, y = C x + D u; with ``dt``, the next x in place of dx/dt.

    `state_space` builds and checks one from arrays or lists.

    Parameters
    ----------
    A, B, C, D
        Matrices (n, n), (n, m), (p, n) and (p, m).
    dt
        The length of a sample in seconds, or None in continuous time.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    dt: float | None = None

    @property
    def sampled(self) -> bool:
        """Whether time is discrete."""
        return self.dt is not None

    @property
    def poles(self) -> ComplexArray:
        """Eigenvalues of A (n,)."""
        return eigenvalues(self.A)

    @property
    def stable(self) -> bool:
        """Whether every pole decays."""
        return is_stable(self.A, sampled=self.sampled)

    def at(self, s: complex) -> ComplexArray:
        """Return the transfer matrix C (s I - A)^-1 B + D (p, m) at one point s, or z."""
        resolvent = np.linalg.solve(s * np.eye(len(self.A)) - self.A, self.B.astype(complex))
        return np.asarray(self.C @ resolvent + self.D, dtype=np.complex128)

    def response(self, frequencies: ArrayLike) -> ComplexArray:
        """Return the transfer matrices (k, p, m) at ``frequencies`` (k,) in rad/s."""
        s = 1j * np.atleast_1d(np.asarray(frequencies, dtype=float))
        points = s if self.dt is None else np.exp(s * self.dt)
        pencils = points[:, np.newaxis, np.newaxis] * np.eye(len(self.A)) - self.A
        inputs = np.broadcast_to(self.B.astype(complex), (len(points), *self.B.shape))
        resolvents = np.linalg.solve(pencils, inputs)
        return np.asarray(self.C @ resolvents + self.D, dtype=np.complex128)

    def __matmul__(self, first: StateSpace) -> StateSpace:
        """Return the series of two systems, ``self`` fed by ``first``: self(s) first(s)."""
        if self.dt != first.dt or self.B.shape[1] != len(first.C):
            raise ValueError(
                f'series: expected {self.B.shape[1]} outputs with dt {self.dt}, '
                f'got {len(first.C)} with dt {first.dt}'
            )
        A = np.block([
            [self.A, self.B @ first.C],
            [np.zeros((len(first.A), len(self.A))), first.A],
        ])  # fmt: skip
        B = np.vstack((self.B @ first.D, first.B))
        return StateSpace(A, B, np.hstack((self.C, self.D @ first.C)), self.D @ first.D, self.dt)

    def closed(self) -> StateSpace:
        """Return the complementary sensitivity T = (I + L)^-1 L of this loop L (m, m).

        Raises
        ------
        ValueError
            If I + D is singular: the loop of direct paths has no solution.
        """
        m = len(self.D)
        try:
            E = np.linalg.inv(np.eye(m) + self.D)
        except np.linalg.LinAlgError:
            raise ValueError('loop: expected I + D that can be inverted') from None
        B = self.B @ E
        return StateSpace(self.A - B @ self.C, B, E @ self.C, E @ self.D, self.dt)

    def channel(self, index: int) -> StateSpace:
        """Return the loop seen by input ``index`` of L (m, m) while all others are closed.

        Raises
        ------
        ValueError
            If the other loops have direct paths without a solution.
        """
        others = np.delete(np.arange(len(self.D)), index)
        A, B, C, D = self.A, self.B, self.C, self.D
        one, rest = [index], others.tolist()
        inner = StateSpace(A, B[:, rest], C[rest], D[np.ix_(rest, rest)], self.dt)
        # with y the outputs of the others and u their inputs, u = -y closes them
        T = inner.closed()
        E = np.eye(len(rest)) - T.D
        through = E @ D[np.ix_(rest, one)]
        return StateSpace(
            T.A,
            B[:, one] - B[:, rest] @ through,
            C[one] - D[np.ix_(one, rest)] @ T.C,
            D[np.ix_(one, one)] - D[np.ix_(one, rest)] @ through,
            self.dt,
        )


def static(D: Array, dt: float | None = None) -> StateSpace:
    """Return the system y = D u (p, m), without a state."""
    p, m = D.shape
    return StateSpace(np.zeros((0, 0)), np.zeros((0, m)), np.zeros((p, 0)), D, dt)


def state_space(
    A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike | None = None, dt: float | None = None
) -> StateSpace:
    """Return a checked system; without ``D`` there is no direct path.

    Raises
    ------
    ValueError
        If sizes do not fit, or ``dt`` is not positive.
    """
    n, m, p = len(np.atleast_1d(A)), np.shape(np.atleast_2d(B))[1], len(np.atleast_2d(C))
    if dt is not None and not dt > 0.0:
        raise ValueError(f'dt: expected a positive number of seconds, got {dt}')
    return StateSpace(
        matrix('A', A, (n, n)),
        matrix('B', B, (n, m)),
        matrix('C', C, (p, n)),
        np.zeros((p, m)) if D is None else matrix('D', D, (p, m)),
        dt,
    )
