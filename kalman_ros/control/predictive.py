# SPDX-License-Identifier: Apache-2.0
"""Model predictive control: the regulator, and what its predicted limits add to it.

The predicted input is u_k = -K x_k + v_k with the gain of the regulator. The cost of the whole
future is then x'S x + sum of v_k'(R + G'S G) v_k, so that v = 0 where no limit acts, which is
the regulator. Where a limit would be exceeded, the v with the least cost follow from a quadratic
program (B. Kouvaritakis, J. Rossiter and J. Schuurmans, Efficient Robust Predictive Control, IEEE
Transactions on Automatic Control 45, 2000). After the horizon the regulator goes on without
limits.

The input of now keeps its limits exactly. Limits of later inputs are soft: with a few moves for
many steps, not all of them can be kept at all steps. Limits of states are soft, at a price, or
hard.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import monotonic
from typing import NamedTuple

import numpy as np

from kalman_ros.core import Array, ArrayLike, one_each

from .least_distance import InfeasibleError, LateError, LeastDistance
from .limiter import Limits
from .lqr import Cost, LqrDesign
from .motion import Motion

#: The price of exceeding a limit of a later input, relative to the cost of an input.
_INPUT_PRICE = 1e6
#: The usual price a second of an excess of a state.
STATE_PRICE = 1e6
#: The steps of a horizon that follows from the poles.
_DECAYS, _FEWEST, _MOST = 4.0, 20, 200
#: The most steps of a horizon, and the most moves in it.
MOST_STEPS, MOST_MOVES = 2000, 200


@dataclass(frozen=True, eq=False)
class Prediction:
    """A plant in steps, its regulator, and limits of states over a horizon.

    Parameters
    ----------
    F, G
        The step x' = F x + G u, (n, n) and (n, m).
    dt
        Length of a step in seconds.
    gain, weight
        K (m, n) and R + G'S G (m, m) of the regulator.
    steps, moves
        Length of the horizon in steps, and the number of stretches with the same v.
    low, high
        Limits of the states (n,).
    price
        Cost of the square of the excess of each state in one step (n,); infinite for limits that
        have to be kept.
    """

    F: Array
    G: Array
    dt: float
    gain: Array
    weight: Array
    steps: int
    moves: int
    low: Array
    high: Array
    price: Array

    def outside(self, state: Array) -> list[int]:
        """Return the coordinates of a state (n,) that are outside of their limits."""
        return [int(i) for i in np.flatnonzero((state < self.low) | (state > self.high))]


def predicted(
    step: tuple[Array, Array],
    price: Cost,
    design: LqrDesign,
    dt: float,
    *,
    horizon: float = 0.0,
    moves: int = 20,
    price_of_states: ArrayLike = STATE_PRICE,
    limits: tuple[Array, Array],
) -> Prediction:
    """Return the prediction of a plant in steps with its regulator.

    Parameters
    ----------
    step
        F (n, n) and G (n, m).
    price
        Cost of a step.
    design
        Regulator with the least cost.
    dt
        Length of a step in seconds.
    horizon
        Seconds; 0 for four times the decay of the slowest pole, within 20 to 200 steps.
    moves
        The number of changes of the input that are planned.
    price_of_states
        Cost a second of the square of the excess of a state; one for all, or (n,).
    limits
        Lowest and highest states (n,).

    Raises
    ------
    ValueError
        If the horizon, the moves or a price are out of range.
    """
    F, G = step
    prices = one_each('state_price', price_of_states, len(F))
    if not (prices > 0.0).all():
        raise ValueError(f'state_price: expected positive numbers, got {prices.tolist()}')
    if isinstance(moves, bool) or moves != int(moves) or not 1 <= moves <= MOST_MOVES:
        raise ValueError(f'moves: expected a whole number from 1 to {MOST_MOVES}, got {moves}')
    return Prediction(
        F,
        G,
        dt,
        design.gain,
        price.input + G.T @ design.cost_to_go @ G,
        _steps_of(horizon, dt, design),
        int(moves),
        *limits,
        dt * prices,
    )


def _steps_of(horizon: float, dt: float, design: LqrDesign) -> int:
    if horizon:
        steps = horizon / dt
        if not 0.5 <= steps <= MOST_STEPS:
            raise ValueError(
                f'horizon: expected {dt:g} to {MOST_STEPS * dt:g} s, got {horizon:g} s'
            )
        return max(round(steps), 1)
    slowest = float(np.abs(design.poles).max(initial=0.0))
    decays = _DECAYS / -np.log(slowest) if 0.0 < slowest < 1.0 else np.inf
    return int(min(max(decays, _FEWEST), _MOST))


def stretches(steps: int, moves: int) -> Array:
    """Return the lengths of stretches that sum to ``steps``: 1 first, then growing by a factor."""
    if moves >= steps:
        return np.ones(steps, dtype=int)

    def lengths(factor: float) -> Array:
        return np.asarray(np.floor(factor ** np.arange(moves)).astype(int))

    low, high = 1.0, float(steps) ** (1.0 / max(moves - 1, 1))  # the last one is not longer
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if lengths(middle).sum() <= steps else (low, middle)
    result = lengths(low)
    result[-1] += steps - result.sum()
    return result


class _Responses(NamedTuple):
    """States x_{k+1} and inputs u_k over the horizon, by the error now and by z."""

    states: Array
    states_by_z: Array
    inputs: Array
    inputs_by_z: Array


def _responses(F: Array, G: Array, K: Array, E: Array) -> _Responses:
    """Return the responses over the horizon.

    Parameters
    ----------
    F, G, K
        Of each step (N, n, n), (N, n, m), (N, m, n).
    E
        v_k by z (N, m, V).
    """
    (N, n, m), V = G.shape, E.shape[2]
    both, states, inputs = np.eye(n, n + V), np.empty((N, n, n + V)), np.empty((N, m, n + V))
    for k in range(N):
        inputs[k] = K[k] @ -both
        inputs[k, :, n:] += E[k]
        both = F[k] @ both + G[k] @ inputs[k]
        states[k] = both
    return _Responses(states[..., :n], states[..., n:], inputs[..., :n], inputs[..., n:])


def _moves(weights: Array, lengths: Array) -> Array:
    """Return v_k by z (N, m, V), where the sum of v_k' W_k v_k is |z|^2.

    Parameters
    ----------
    weights
        W_k (N, m, m).
    lengths
        Numbers of steps with the same v.
    """
    m = weights.shape[1]
    ends = np.cumsum(lengths)
    total = np.add.reduceat(weights, np.append(0, ends[:-1]))
    roots = np.linalg.inv(np.linalg.cholesky(total)).swapaxes(-1, -2)
    E = np.zeros((len(weights), m, m * len(lengths)))
    for block, (root, length, end) in enumerate(zip(roots, lengths, ends)):
        E[end - length : end, :, m * block : m * (block + 1)] = root
    return E


class _Sides:
    """Limits of some values (c,) over the horizon as rows: all steps of one limit, then the next.

    Parameters
    ----------
    by_error, by_z
        The values by the error now (N, c, n), and by z (N, c, V).
    low, high
        Their limits (c,).
    softness
        Inverse of the price of an excess (N, c).
    """

    def __init__(
        self, by_error: Array, by_z: Array, low: Array, high: Array, softness: Array
    ) -> None:
        upper, lower = np.flatnonzero(np.isfinite(high)), np.flatnonzero(np.isfinite(low))
        self._chosen = np.append(upper, lower)
        self._sign = np.append(np.ones(len(upper)), -np.ones(len(lower)))[:, np.newaxis]
        self._limit = np.append(high[upper], -low[lower])[:, np.newaxis]
        signs = self._sign[:, np.newaxis]

        def rows(part: Array) -> Array:
            return np.moveaxis(part[:, self._chosen], 1, 0) * signs

        self._by_error = rows(by_error)
        self.rows: Array = rows(by_z).reshape(-1, by_z.shape[2])
        self.softness: Array = softness.T[self._chosen].ravel()

    def bounds(self, error: Array, offset: Array) -> Array:
        """Return what z may add in each row, where the reference has values (N, c) or (1, c)."""
        if not len(self._chosen):
            return np.empty(0)
        values = self._sign * offset.T[self._chosen] + self._by_error @ error
        return np.asarray((self._limit - values).ravel())


class _Program(NamedTuple):
    """Limits of inputs, their changes and states; the problem that they make; v_k by z.

    ``softened`` is the problem in which limits of states that have to be kept have a price, for
    steps in which they cannot be kept; None if there are no such limits.
    """

    sides: tuple[_Sides, ...]
    problem: LeastDistance
    moves: Array
    softened: LeastDistance | None


@dataclass
class _Memory:
    """The last plan of a loop, the limits that act in it, and its age in steps."""

    z: Array | None = None
    active: Sequence[int] = ()
    age: int = 0


class Predictor:
    """Computes what the limits add to the input of the regulator.

    Parameters
    ----------
    prediction
        The plant, its regulator and the limits of states.
    limits
        Limits of the inputs.
    budget
        Seconds after which a solution is given up.
    """

    def __init__(self, prediction: Prediction, limits: Limits, budget: float = np.inf) -> None:
        self._budget, self._limits, self._prediction = budget, limits, prediction
        N = prediction.steps
        self._lengths = stretches(N, prediction.moves)
        steady = [np.broadcast_to(part, (N, *part.shape)) for part in (
            prediction.F, prediction.G, prediction.gain, prediction.weight)]  # fmt: skip
        self._steady = self._program(*steady)
        self._memories: list[_Memory] = []
        #: How often a limit acted, no plan was within the hard limits, and none was in time.
        self.limited = self.infeasible = self.late = 0

    def _program(self, F: Array, G: Array, K: Array, W: Array) -> _Program:
        """Return the program of these steps, gains and weights over the horizon."""
        prediction, limits = self._prediction, self._limits
        moves = _moves(W, self._lengths)
        by = _responses(F, G, K, moves)
        changes, changes_by_z = (
            np.diff(part, axis=0, prepend=np.zeros((1, *part.shape[1:])))
            for part in (by.inputs, by.inputs_by_z)
        )
        later = 1.0 / (_INPUT_PRICE * np.diagonal(W, axis1=1, axis2=2))
        later[0] = 0.0
        excess = np.broadcast_to(1.0 / prediction.price, by.states.shape[:2])
        change = limits.rate * prediction.dt
        sides = (
            _Sides(by.inputs, by.inputs_by_z, limits.lower, limits.upper, later),
            _Sides(changes, changes_by_z, -change, change, later),
            _Sides(by.states, by.states_by_z, prediction.low, prediction.high, excess),
        )
        rows = np.concatenate([side.rows for side in sides])
        softness = np.concatenate([side.softness for side in sides])
        softened, states = None, sides[-1].softness
        if not states.all():
            soft = np.where(states > 0.0, states, 1.0 / (STATE_PRICE * prediction.dt))
            softness_of_all = np.concatenate((softness[: len(softness) - len(soft)], soft))
            softened = LeastDistance(rows, softness_of_all)
        return _Program(sides, LeastDistance(rows, softness), moves, softened)

    @property
    def steps(self) -> int:
        """The number of steps of the horizon."""
        return self._prediction.steps

    def forget(self) -> None:
        """Forget the last plan, as after an input of another source."""
        self._memories = []

    def correction(self, error: Array, ahead: Motion, before: Array) -> Array:
        """Return v_0 (m,), to be added to the input of the regulator.

        Parameters
        ----------
        error
            Difference (n,) of the state from the reference; with a leading axis, of several loops.
        ahead
            The reference over the horizon, or one state and input for all of it.
        before
            The last input (m,).
        """
        errors = np.atleast_2d(error)
        inputs = np.broadcast_to(before, (len(errors), before.shape[-1]))
        inputs = self._limits.within(inputs)
        while len(self._memories) < len(errors):
            self._memories.append(_Memory())
        program = self._steady
        if ahead.differences is not None and ahead.gains is not None:
            F, G, W = (part[:-1] for part in ahead.differences)
            program = self._program(F, G, ahead.gains[:-1], W)
        moves = [
            self._move(program, memory, error, last, ahead)
            for memory, error, last in zip(self._memories, errors, inputs)
        ]
        return np.reshape(moves, before.shape if error.ndim == 1 else inputs.shape)

    def _move(
        self, program: _Program, memory: _Memory, error: Array, before: Array, ahead: Motion
    ) -> Array:
        """Return v_0 (m,) of a loop."""
        b = self._bounds(program, error, before, ahead)
        if b.min(initial=0.0) >= 0.0 or not np.isfinite(b).all():
            memory.z, memory.active, memory.age = None, (), 0
            return np.zeros(len(before))
        self.limited += 1
        deadline = monotonic() + self._budget
        try:
            with np.errstate(over='ignore', invalid='ignore'):
                shortest = program.problem.solve(b, self._shifted(memory.active), deadline)
            if not np.isfinite(shortest.z).all():
                raise InfeasibleError('no plan is finite')
            memory.z, memory.active, memory.age = shortest.z, shortest.active, 0
        except LateError:
            self.late += 1
            memory.age, memory.active = memory.age + 1, ()
        except (InfeasibleError, np.linalg.LinAlgError):
            self.infeasible += 1
            memory.age, memory.active = memory.age + 1, ()
            self._soften(program, memory, b, deadline)
        if memory.z is None or memory.age >= self.steps:
            return np.zeros(len(before))
        return np.asarray(program.moves[memory.age] @ memory.z)

    def _soften(self, program: _Program, memory: _Memory, b: Array, deadline: float) -> None:
        """Replace the last plan by one that comes back within limits that cannot be kept."""
        if program.softened is None:
            return
        try:
            with np.errstate(over='ignore', invalid='ignore'):
                shortest = program.softened.solve(b, (), deadline)
            if np.isfinite(shortest.z).all():
                memory.z, memory.age = shortest.z, 0
        except LateError:
            self.late += 1
        except (InfeasibleError, np.linalg.LinAlgError):
            return

    def _bounds(self, program: _Program, error: Array, before: Array, ahead: Motion) -> Array:
        """Return what z may add in each row."""
        inputs = np.broadcast_to(ahead.inputs[: self.steps], (self.steps, len(before)))
        changes = np.diff(inputs, axis=0, prepend=before[np.newaxis])
        states = self._turned(ahead.states if len(ahead.states) == 1 else ahead.states[1:], ahead)
        offsets = inputs, changes, states
        return np.concatenate(
            [side.bounds(error, offset) for side, offset in zip(program.sides, offsets)]
        )

    def _turned(self, states: Array, ahead: Motion) -> Array:
        """Return states whose angles are the nearest to the middle of their limits."""
        low, high = self._prediction.low, self._prediction.high
        for index in ahead.space.indices(ahead.space.angles):
            if np.isfinite(low[index]) and np.isfinite(high[index]):
                middle = 0.5 * (low[index] + high[index])
                states = states.copy()
                angle = np.unwrap(states[:, index])
                turns = np.round((middle - angle[0]) / (2.0 * np.pi))
                states[:, index] = angle + 2.0 * np.pi * turns
        return states

    def plan(self, error: Array, ahead: Motion) -> tuple[Array, Array]:
        """Return the planned states (N + 1, n) and inputs (N, m) from an error (n,) on."""
        prediction, N = self._prediction, self.steps
        memory = self._memories[0] if self._memories else _Memory()
        e, states, inputs = error, [error], []
        for k in range(N):
            at = memory.age + k
            idle = memory.z is None or at >= N
            v = 0.0 if idle else self._steady.moves[at] @ memory.z
            inputs.append(v - prediction.gain @ e)
            e = prediction.F @ e + prediction.G @ inputs[-1]
            states.append(e)
        return np.array(states) + ahead.states, np.array(inputs) + ahead.inputs[:N]

    def _shifted(self, active: Sequence[int]) -> list[int]:
        """Return the limits that act in the rest of a plan, seen one step later."""
        return [row - 1 for row in active if row % self.steps]
