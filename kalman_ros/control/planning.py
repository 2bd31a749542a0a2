# SPDX-License-Identifier: Apache-2.0
"""The motion of a model that is nearest to a wanted one, with the inputs that it needs.

It minimises the sum of squared differences from the reference, and with a small weight the
squares of the inputs, over all states and inputs that the model can have. States and inputs are
both unknown (multiple shooting); each iteration linearises the steps along the whole motion and
solves the linear-quadratic problem by a Riccati recursion (M. Giftthaler, M. Neunert, M. Stauble,
J. Buchli and M. Diehl, A Family of Iterative Gauss-Newton Shooting Methods for Nonlinear Optimal
Control, IROS 2018). No property of the model is used, such as flatness or an inverse.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kalman_ros.core import Array, Dynamics, OperatingPoint, Space
from kalman_ros.linear.matrices import symmetric

from .lqr import Cost
from .motion import Motion
from .time_varying import Linearization, linearized_along

#: The weights of a difference from the reference that are tried, the first and the last, relative
#: to that in the cost of the regulator.
_FIRST, _LAST = 1e2, 1e12
#: The weight of a difference from the state at which a motion ends, relative to these.
_HELD = 1e8
#: The weight of leaving the input of before at the start of a motion, relative to that of inputs.
_LEFT = 100.0
#: Ten times the weight is of use where differences fall to this share, or where the inputs still
#: count: they grow by this factor, or cost this share of the cost of the differences.
_NEARER, _GROWN, _COUNTED = 0.5, 7.0, 0.5
_MOST_ITERATIONS = 100
#: A change of states below this, relative to their size, ends the iteration.
_CONVERGED = 1e-9
#: So does a decrease of the cost below this, relative to it, once the steps leave no gaps.
_SLOW = 1e-4
#: The largest gap that the steps of a motion may leave, relative to the size of the states.
_CLOSED = 1e-6
#: A shorter share of a step is not taken; the inputs are damped instead.
_SHORTEST = 1e-3
#: The largest distance from where a motion shall end, relative to the states.
_ARRIVED = 1e-3
#: The first damping, relative to the weight of the inputs (K. Levenberg, 1944).
_DAMPED = 1.0
#: The finest accuracy.
_FINEST = 1e-9
#: The most steps of a motion.
MOST_STEPS = 60_000


@dataclass(frozen=True, eq=False)
class ReferenceMotion:
    """A wanted motion: values of some coordinates of the state in steps of ``dt``.

    Parameters
    ----------
    dt
        Length of a step in seconds.
    coordinates
        Indices of the coordinates that are given (k,).
    values
        Their values (N + 1, k).
    hints
        Where other coordinates are likely to be, by index, (N + 1,) each: the heading along a
        path. They are not required.
    start
        State (n,) at which it begins; None where only the values count.
    end
        Where it ends at rest; None where only the values count.
    guess
        States (N + 1, n) from which the search starts; by default the values, elsewhere the
        equilibrium.
    resting
        Directions in which it may end elsewhere at rest, with the change of the input that this
        needs, as columns (n, r) and (m, r).
    joining
        Seconds in which it comes to the reference from where it starts; there it may be away.
    input
        Input (m,) before it starts, from which it leaves slowly while it joins; None for any.
    """

    dt: float
    coordinates: tuple[int, ...]
    values: Array
    hints: dict[int, Array]
    start: Array | None = None
    end: OperatingPoint | None = None
    guess: Array | None = None
    resting: tuple[Array, Array] | None = None
    joining: float = 0.0
    input: Array | None = None

    @property
    def joined(self) -> Array:
        """By how much each value counts (N + 1,): from 0 at the start to 1."""
        steps = np.arange(len(self.values))
        return np.minimum(steps / max(self.joining / self.dt, 1e-9), 1.0)

    def end_near(self, space: Space, state: Array) -> OperatingPoint:
        """Return where it ends at rest, nearest to a state (n,)."""
        assert self.end is not None
        if self.resting is None:
            return self.end
        directions, inputs = self.resting
        difference = space.subtract(state, self.end.state)
        amount = np.linalg.lstsq(directions, difference, rcond=None)[0]
        return OperatingPoint(
            space.add(self.end.state, directions @ amount), self.end.input + inputs @ amount
        )


def fit(
    model: Dynamics,
    reference: ReferenceMotion,
    weights: Cost,
    accuracy: float = 1e-3,
    interrupt: Callable[[], None] = lambda: None,
) -> Motion:
    """Return the motion of a model that is nearest to a reference.

    Coordinates that the reference does not give are free, except at its start and end.

    Parameters
    ----------
    model
        The model to move.
    reference
        The wanted motion.
    weights
        Weights of the regulator, which say how differences of the coordinates compare.
    accuracy
        How near it shall come, in the units of the coordinates. Differences get the more weight
        until it does, or comes no nearer.
    interrupt
        Called before each iteration; what it raises ends the search.

    Raises
    ------
    ValueError
        If no motion is found; the message names the state and the time at which it fails.
    """
    followed, best, least, size = _FIRST, None, np.inf, 0.0
    accuracy = max(accuracy, _FINEST)
    while True:
        problem = _Problem(model, reference, weights, followed, interrupt)
        try:
            nearest = problem.minimum(*(best or problem.first_guess()))
        except ValueError:
            if best is None:
                raise
            break
        off = max(problem.deviation(nearest[0]) / accuracy, problem.end_missed(nearest[0]))
        tracking, needed = problem.costs(*nearest)
        counted = needed > _GROWN**2 * size or needed > _COUNTED * tracking
        if best is not None and off > _NEARER * least and not counted:
            break  # no nearer, at the price of larger inputs
        best, least, size = nearest, off, needed
        if off <= 1.0 or followed >= _LAST:
            break
        followed *= 10.0
    states, inputs = best
    problem.check_end(states)
    final = inputs[-1]
    if reference.end is not None:  # exactly, from which the weights leave it a little away
        rest = reference.end_near(model.state, states[-1])
        states[-1], final = model.state.wrap(rest.state), rest.input
    return Motion(model.state, reference.dt, states, np.vstack((inputs, final)))


@dataclass(frozen=True, eq=False)
class _Solution:
    """Changes of states (N + 1, n) and inputs (N, m), their size, and the penalty of gaps (n,)."""

    states: Array
    inputs: Array
    size: float
    penalty: Array


class _Problem:
    """The least-squares problem of a reference."""

    def __init__(
        self,
        model: Dynamics,
        reference: ReferenceMotion,
        weights: Cost,
        followed: float,
        interrupt: Callable[[], None],
    ) -> None:
        self._model, self._reference, self._space = model, reference, model.state
        self._interrupt = interrupt
        self.rest_state, self.rest_input = model.equilibrium
        diagonal = weights.state.diagonal().copy()
        positive = diagonal[diagonal > 0.0]
        diagonal[diagonal == 0.0] = positive.mean() if positive.size else 1.0
        q = np.zeros(len(diagonal))
        q[list(reference.hints)] = diagonal[list(reference.hints)]
        given = list(reference.coordinates)
        q[given] = followed * diagonal[given]
        self._q: Array = np.tile(q, (len(reference.values), 1))
        softer = (_FIRST / followed) ** (1.0 - reference.joined)
        self._q[:, given] *= softer[:, np.newaxis] if reference.joining else 1.0
        self._Q_end: Array = np.diag(self._q[-1])
        if reference.end is not None:
            self._q[-1] = 0.0
            self._Q_end = _end_weight(_HELD * followed * diagonal, reference.resting)
        self._R = np.tile(weights.input, (len(reference.values) - 1, 1, 1))
        self._u_wanted: Array = np.tile(self.rest_input, (len(self._R), 1))
        if reference.input is not None:
            fading = (1.0 - reference.joined[:-1])[:, np.newaxis]
            self._u_wanted += fading * (reference.input - self.rest_input)
            self._R *= (1.0 + _LEFT * fading**6)[..., np.newaxis]
        self._wanted = self._wanted_states()
        self._scale = np.maximum(1.0, np.abs(self._wanted).max(axis=0))

    def _wanted_states(self) -> Array:
        reference = self._reference
        wanted = np.tile(self.rest_state, (len(reference.values), 1))
        for index, values in reference.hints.items():
            wanted[:, index] = values
        wanted[:, list(reference.coordinates)] = reference.values
        if reference.start is not None:
            wanted[0] = reference.start
        if reference.end is not None:
            wanted[-1] = reference.end.state
        return self._space.wrap(wanted)

    def first_guess(self) -> tuple[Array, Array]:
        """Return states and inputs from which the search starts."""
        guess = self._reference.guess
        states = (self._wanted if guess is None else self._space.wrap(guess)).copy()
        if self._reference.start is not None:
            states[0] = self._wanted[0]
        return states, np.tile(self.rest_input, (len(self._wanted) - 1, 1))

    def minimum(self, states: Array, inputs: Array) -> tuple[Array, Array]:
        """Return the states and inputs of the motion that is nearest, from a first guess.

        Raises
        ------
        ValueError
            If none is found.
        """
        damping = 0.0
        for _ in range(_MOST_ITERATIONS):
            self._interrupt()
            solution = self.solve(states, inputs, damping)
            before, share = self.merit(states, inputs, solution.penalty), 1.0
            while True:
                candidate = self.moved(states, inputs, solution, share)
                after = self.merit(*candidate, solution.penalty)
                better = after <= before
                if better or share < _SHORTEST or share * solution.size < _CONVERGED:
                    break
                share *= 0.5
            if better or share >= _SHORTEST:
                states, inputs = candidate
            slow = before - after <= _SLOW * before and self.is_closed(states, inputs)
            if solution.size < _CONVERGED or (better and slow):
                break
            damping = 0.1 * damping if share == 1.0 else max(10.0 * damping, _DAMPED)
        self.check_closed(states, inputs)
        return states, inputs

    def deviation(self, states: Array) -> float:
        """Return the largest difference from the values of the reference, once it is joined."""
        off = self._space.subtract(states, self._wanted)[:, list(self._reference.coordinates)]
        off = off[self._reference.joined >= 1.0]
        return float(np.abs(off).max(initial=0.0))

    def costs(self, states: Array, inputs: Array) -> tuple[float, float]:
        """Return the cost of the differences and that of the inputs."""
        e = self._space.subtract(states, self._wanted)
        w = inputs - self._u_wanted
        tracking = float(np.sum(self._q * e * e)) + float(e[-1] @ self._Q_end @ e[-1])
        return 0.5 * tracking, 0.5 * float(np.einsum('ki,kij,kj', w, self._R, w))

    def gaps(self, states: Array, inputs: Array) -> Array:
        """Return by how much each step misses the next state (N, n)."""
        reached = self._model.step(states[:-1], inputs, self._reference.dt)
        return self._space.subtract(reached, states[1:])

    def merit(self, states: Array, inputs: Array, penalty: Array) -> float:
        """Return the cost, and the gaps by their penalty; infinite where it is not finite."""
        with np.errstate(all='ignore'):
            value = sum(self.costs(states, inputs))
            value += float(np.sum(penalty * np.abs(self.gaps(states, inputs))))
        return value if np.isfinite(value) else np.inf

    def moved(
        self, states: Array, inputs: Array, solution: _Solution, share: float
    ) -> tuple[Array, Array]:
        """Return states and inputs changed by a share of a solution."""
        moved = self._space.add(states, share * solution.states)
        return moved, inputs + share * solution.inputs

    def solve(self, states: Array, inputs: Array, damping: float) -> _Solution:
        """Return the changes that solve the problem linearised about states and inputs.

        With a ``damping``, changes of the inputs have this weight, too, relative to theirs.
        """
        d = self.gaps(states, inputs)
        steps = linearized_along(self._model, states[:-1], inputs, self._reference.dt)
        if not (np.isfinite(d).all() and all(np.isfinite(part).all() for part in steps)):
            raise self._failure(states, d, 'the model is not finite')
        off = self._space.subtract(states, self._wanted)
        e = self._q * off
        e[-1] = self._Q_end @ off[-1]
        r = np.einsum('ki,kij->kj', inputs - self._u_wanted, self._R)
        K, k, S, s = self._backward(steps, d, e, r, (1.0 + damping) * self._R)
        dx = np.empty_like(states)
        held = self._reference.start is not None
        dx[0] = np.zeros(len(e[0])) if held else -_least_squares(S[0], s[0])
        du = np.empty_like(inputs)
        for i, (F, G) in enumerate(zip(*steps)):
            du[i] = -(K[i].dot(dx[i]) + k[i])
            dx[i + 1] = F.dot(dx[i]) + G.dot(du[i]) + d[i]
        costates = np.einsum('kij,kj->ki', S, dx) + s
        penalty = 1.1 * np.abs(costates).max(axis=0)
        return _Solution(dx, du, float((np.abs(dx) / self._scale).max()), penalty)

    def _backward(
        self, steps: Linearization, d: Array, e: Array, r: Array, R: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Return gains K (N, m, n) and k (N, m), and the cost-to-go, S (N + 1, n, n) and s.

        ``d`` are the gaps, ``e`` and ``r`` the gradients of the cost by states and inputs, and
        ``R`` are the weights of changes of the inputs (N, m, m).
        """
        N, (n, m) = len(steps.F), steps.G.shape[1:]
        K, k = np.empty((N, m, n)), np.empty((N, m))
        S, s = np.empty((N + 1, n, n)), np.empty((N + 1, n))
        q = self._q
        S[N], s[N] = self._Q_end, e[N]
        for i in range(N - 1, -1, -1):
            F, G = steps.F[i], steps.G[i]
            GS = G.T.dot(S[i + 1])
            ahead = S[i + 1].dot(d[i]) + s[i + 1]
            L = GS.dot(F)
            both = np.linalg.solve(R[i] + GS.dot(G), np.column_stack((L, G.T.dot(ahead) + r[i])))
            K[i], k[i] = both[:, :n], both[:, n]
            S[i] = symmetric(np.diag(q[i]) + F.T.dot(S[i + 1]).dot(F) - L.T.dot(K[i]))
            s[i] = e[i] + F.T.dot(ahead) - L.T.dot(k[i])
        return K, k, S, s

    def end_missed(self, states: Array) -> float:
        """Return the distance from where a motion shall end, relative to the largest allowed."""
        return float(self._end_distances(states).max() / _ARRIVED)

    def check_end(self, states: Array) -> None:
        """Raise ValueError if a motion does not end where it shall."""
        if self.end_missed(states) > 1.0:
            index = int(np.argmax(self._end_distances(states)))
            away = self._end_distances(states)[index] * self._scale[index]
            name, unit = self._space.names[index], self._space.units[index]
            raise ValueError(f'it does not end where it should: {name} is {away:.3g} {unit} away')

    def _end_distances(self, states: Array) -> Array:
        """Return how far a motion ends from where it shall (n,), relative to the states."""
        if self._reference.end is None:
            return np.zeros_like(self._scale)
        rest = self._reference.end_near(self._space, states[-1])
        return np.asarray(np.abs(self._space.subtract(states[-1], rest.state)) / self._scale)

    def is_closed(self, states: Array, inputs: Array) -> bool:
        """Return whether states and inputs are a motion of the model."""
        return bool((np.abs(self.gaps(states, inputs)) <= _CLOSED * self._scale).all())

    def check_closed(self, states: Array, inputs: Array) -> None:
        """Raise ValueError if states and inputs are no motion of the model."""
        if not self.is_closed(states, inputs):
            d = self.gaps(states, inputs)
            raise self._failure(states, d, 'no motion of the model was found')

    def _failure(self, states: Array, d: Array, why: str) -> ValueError:
        size = np.nan_to_num(np.abs(d) / self._scale, nan=np.inf)
        step, index = np.unravel_index(int(np.argmax(size)), size.shape)
        at = float(step) * self._reference.dt
        return ValueError(f'{why}: it fails at {self._space.names[index]}, {at:.3g} s')


def _end_weight(diagonal: Array, resting: tuple[Array, Array] | None) -> Array:
    """Return the weight (n, n) of a difference at the end, without that of some directions."""
    if resting is None:
        return np.diag(diagonal)
    root = np.sqrt(diagonal)
    free = np.linalg.qr(root[:, np.newaxis] * resting[0])[0]
    left = np.eye(len(root)) - free @ free.T
    return np.asarray(symmetric(root[:, np.newaxis] * left * root))


def _least_squares(S: Array, s: Array) -> Array:
    """Return the least x with S x = s, whatever the units of its coordinates are."""
    scale = np.sqrt(S.diagonal())
    scale[scale == 0.0] = 1.0
    scaled = S / np.outer(scale, scale)
    return np.asarray(np.linalg.lstsq(scaled, s / scale, rcond=1e-12)[0] / scale)
