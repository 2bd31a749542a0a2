# SPDX-License-Identifier: Apache-2.0
"""Predictive control from matrices or a model: limits of inputs and states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kalman_ros.control.feedback import Feedback
from kalman_ros.control.feedback import Regulator as Answer
from kalman_ros.control.laws import bounds
from kalman_ros.control.limiter import Limiter, Limits, limits_of
from kalman_ros.control.lqr import cost, dlqr, sampled_cost
from kalman_ros.control.motion import Motion
from kalman_ros.control.predictive import predicted
from kalman_ros.core import Array, ArrayLike, Dynamics, Gaussian, Space
from kalman_ros.core.known_arguments import knows_arguments
from kalman_ros.core.known_names import KnownNames

from . import text
from .accept import (
    finite,
    limits_given,
    number,
    numbers,
    plant,
    sample_time,
    shifted,
    weight,
    whole,
)
from .estimates import _path


class Plan(NamedTuple):
    """A plan: times from its start (N + 1,), states (N + 1, n) and inputs (N, m)."""

    time: Array
    states: Array
    inputs: Array


class PredictiveControl(KnownNames):
    """Model predictive control, one input a step; `mpc` makes it.

    Where no limit acts, it is the linear-quadratic regulator, u = -K x. It brings the state to the
    equilibrium; for other references, and motions, use `Regulator` with ``{'law': 'mpc'}``.
    """

    def __init__(
        self,
        space: Space,
        inputs: tuple[str, ...],
        feedback: Feedback,
        limits: Limits,
        rest: tuple[Array, Array],
    ) -> None:
        assert feedback.prediction is not None
        self._space, self._inputs, self._rest, self._limits = space, inputs, rest, limits
        self._feedback, self._prediction = feedback, feedback.prediction
        self._answer = Answer(space, feedback, rest, limits=limits, start=rest[1])
        self._limiter = Limiter(limits, rest[1])
        self._state, self._planned = rest[0], True

    @property
    def dt(self) -> float:
        """The length of a step in seconds."""
        return self._prediction.dt

    @property
    def gain(self) -> Array:
        """K (m, n) of the regulator."""
        return self._feedback.gain

    @property
    def horizon(self) -> float:
        """Seconds over which limits are predicted."""
        return self._prediction.steps * self.dt

    @property
    def limited(self) -> int:
        """The number of steps in which a limit acted on the plan."""
        assert self._answer.predictor is not None
        return self._answer.predictor.limited

    @property
    def infeasible(self) -> int:
        """The number of steps without a plan within the limits that have to be kept."""
        assert self._answer.predictor is not None
        return self._answer.predictor.infeasible

    def step(self, estimate: Gaussian | ArrayLike) -> Array:
        """Return the input (m,) for an estimate, a step after the last one.

        Parameters
        ----------
        estimate
            A state (n,), or a belief, of which the mean counts.

        Raises
        ------
        ValueError
            If the estimate is not a finite state.
        """
        given = estimate.mean if isinstance(estimate, Gaussian) else estimate
        self._state = finite('estimate', given, self._space.size)
        before = self.infeasible
        wanted = self._answer.propose(self._state, self.dt)
        self._planned = self.infeasible == before
        u = self._limiter.toward(wanted, self.dt)
        self._answer.applied(self._state, wanted, u, self.dt)
        return u

    @property
    def plan(self) -> Plan:
        """The plan of the last step.

        Raises
        ------
        ValueError
            If that step found none within the limits that have to be kept.
        """
        if not self._planned:
            raise ValueError('plan: the last step found none within the limits')
        assert self._answer.predictor is not None
        state, input = self._answer.target
        error = self._space.subtract(self._state, state)
        held = Motion(self._space, self.dt, state[np.newaxis], input[np.newaxis])
        states, inputs = self._answer.predictor.plan(error, held)
        return Plan(np.asarray(np.arange(len(states)) * self.dt), states, inputs)

    def plot(self, path: str | Path | None = None) -> Any:
        """Draw the plan of the last step and its limits.

        Returns
        -------
        The axes of a figure of matplotlib, which a notebook shows and ``plt.show()`` opens; with a
        ``path`` the figure is saved there instead, and closed.
        """
        from kalman_ros.report.plan_picture import plan_picture  # matplotlib is slow to load

        prediction = self._prediction
        states, inputs = (
            (prediction.low, prediction.high),
            (self._limits.lower, self._limits.upper),
        )
        return plan_picture(self.plan, self._space, self._inputs, states, inputs, _path(path))

    def __repr__(self) -> str:
        prediction = self._prediction
        lines = [
            f'predictive control over {self.horizon:.4g} s, {prediction.steps} steps of '
            f'{self.dt:g} s in {prediction.moves} moves; without limits u = -K x, K ='
        ]
        lines += text.matrix(self._inputs, self._space.names, self.gain)
        limits = self._limits
        for name, low, high, rate in zip(self._inputs, limits.lower, limits.upper, limits.rate):
            if np.isfinite(low) or np.isfinite(high):
                within = f'± {high:g}' if low == -high else f'{low:g} to {high:g}'
                lines.append(f'{name} within {within}')
            if np.isfinite(rate):
                lines.append(f'{name} changes by at most {rate:g} a second')
        for name, low, high, price in zip(
            self._space.names, prediction.low, prediction.high, prediction.price
        ):
            if np.isfinite(low) or np.isfinite(high):
                kept = 'kept' if np.isinf(price) else f'price {price / self.dt:g} a second'
                lines.append(f'{name} within {low:g} to {high:g}, {kept}')
        return '\n'.join(lines)


@knows_arguments(
    N='horizon, in seconds, and moves',
    Np='horizon, in seconds',
    Nc='moves',
    umin='input_lower_limit',
    umax='input_limit',
    xmin='state_limit',
    xmax='state_limit',
    Ts='dt',
)
def mpc(
    A: Any,
    B: ArrayLike | None = None,
    Q: ArrayLike | None = None,
    R: ArrayLike | None = None,
    *,
    dt: float | None = None,
    input_limit: ArrayLike | None = None,
    input_lower_limit: ArrayLike | None = None,
    input_rate_limit: ArrayLike | None = None,
    state_limit: Mapping[str, Sequence[float]] | None = None,
    state_price: ArrayLike = 1e6,
    horizon: float = 0.0,
    moves: int = 20,
) -> PredictiveControl:
    """Return the regulator with the least cost within limits of inputs and states.

    Parameters
    ----------
    A, B
        Of dx/dt = A x + B u; or a system alone, ``mpc(model, Q, R, dt=0.01)``, about its
        equilibrium. For one in discrete time the sum of the cost is minimised.
    Q, R
        Weights (n, n) and (m, m), as for `lqr`.
    dt
        Length of a step in seconds, during which the input is held.
    input_limit, input_lower_limit, input_rate_limit
        Largest magnitude of the input, its smallest value where that is another, and its
        largest change per second; one number for all inputs.
    state_limit
        [low, high] by the name of a state; of matrices ``x0``, ``x1`` and so on.
    state_price
        Cost a second of the square of the excess over a limit; infinite for limits that
        have to be kept. One number for all states.
    horizon
        Seconds over which limits are predicted; 0 for four times the decay of the slowest pole.
    moves
        The number of corrections of u = -K x that are planned, each held for longer than the one
        before. One for each step plans any input; with fewer, the cost of a plan that is on a
        limit for long is some hundredths larger.

    Raises
    ------
    ValueError
        If an argument is invalid.
    DesignError
        If no gain stabilises the system with these weights.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> control = kr.mpc([[0, 1], [0, 0]], [0, 1], [1, 0], 1, dt=0.1, input_limit=0.5)
    >>> control.step([1.0, 0.0])
    array([-0.5])
    """
    model = A if isinstance(A, Dynamics) else None
    B, Q, R = shifted(A, (B, Q, R))
    process = plant(A, B)
    n, m = process.B.shape
    if not m:
        raise ValueError('B: expected at least one input, got a system without')
    dt = sample_time(process, dt)
    if dt is None:
        raise ValueError('dt: expected the length of a step in seconds, got nothing')
    weights = cost(weight('Q', Q, n), weight('R', R, m, definite=True), (n, m))
    step, price = (process.A, process.B), weights
    if process.dt is None:
        sampled = process.system.sampled(dt)
        step, price = (sampled.F, sampled.G), sampled_cost(process.system, weights, dt)
    space = Space(process.states, ('',) * n) if model is None else model.state
    limits = limits_of(m, limits_given(input_limit, input_lower_limit, input_rate_limit))
    pairs: Any = {} if state_limit is None else state_limit
    if isinstance(pairs, Mapping):
        pairs = {
            name: numbers(f'state_limit.{name}', pair).tolist() for name, pair in pairs.items()
        }
    design = dlqr(*step, price)
    prediction = predicted(
        step, price, design, dt, horizon=number('horizon', horizon), moves=whole('moves', moves),
        price_of_states=numbers('state_price', state_price), limits=bounds(space, pairs),
    )  # fmt: skip
    feedback = Feedback(design.gain, np.empty((m, 0)), (), design.poles, prediction)
    rest = (np.zeros(n), np.zeros(m)) if model is None else model.equilibrium
    limits.check('the input at rest', rest[1])
    return PredictiveControl(space, process.inputs, feedback, limits, rest)
