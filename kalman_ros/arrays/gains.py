# SPDX-License-Identifier: Apache-2.0
"""Gains from matrices: LQR, pole placement, the steady-state Kalman filter, margins.

Where a symmetric matrix is expected, a number means that number times the identity and a
list the diagonal. B may be a flat list for one input, C for one reading. Instead of A and B, a
model is accepted, which is linearised about its equilibrium, or a system of python-control or
scipy.signal; a transfer function is realised in controllable canonical form.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from kalman_ros.control import lqr as regulation
from kalman_ros.control.state_space import state_space
from kalman_ros.core import ArrayLike, DesignError, Discretization, Dynamics, linearize
from kalman_ros.core.known_arguments import knows_arguments
from kalman_ros.linear import placement

from .accept import (
    Plant,
    check_still,
    columns,
    duration,
    is_system,
    numbers,
    plant,
    refuse_continuous,
    rows,
    sample_time,
    shifted,
    square,
    weight,
)
from .foreign import read_system
from .gain_results import InputMargins, LoopMargins, Sampled, StateFeedback


@knows_arguments(
    Ts='dt',
    integral_action="make_scenario(..., law='lqi')",
    method='none: lqr solves by one method',
)
def lqr(
    A: Any,
    B: ArrayLike | None = None,
    Q: ArrayLike | None = None,
    R: ArrayLike | None = None,
    N: ArrayLike | None = None,
    *,
    dt: float | None = None,
) -> StateFeedback:
    """Return the gain that minimises the integral of x'Q x + 2 x'N u + u'R u: ``lqr(A, B, Q, R)``.

    Parameters
    ----------
    A, B
        Of dx/dt = A x + B u; or a system alone, ``lqr(model, Q, R)``. For one in discrete time
        the sum of the cost is minimised.
    Q, R, N
        Weights (n, n), (m, m) and (n, m).
    dt
        Seconds for which the input is held. The cost is still the integral: plant and cost are
        sampled exactly.

    Raises
    ------
    ValueError
        If a matrix has the wrong size.
    DesignError
        If no gain stabilises the system with these weights, or one is not positive
        (semi-)definite, or of an absurd size.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kr.lqr([[0, 1], [0, 0]], [0, 1], 1, 1).K.round(4)
    array([[1.    , 1.7321]])
    """
    B, Q, R, N = shifted(A, (B, Q, R, N))
    process = plant(A, B)
    weights = _cost(process, Q, R, N)
    dt = sample_time(process, dt)
    with _named():
        if process.dt is not None:
            return _optimal(process, regulation.dlqr(process.A, process.B, weights))
        if dt is None:
            return _optimal(process, regulation.lqr(process.A, process.B, weights))
        step = process.system.sampled(dt)
        design = regulation.sampled_lqr(process.system, weights, dt)
        return _optimal(replace(process, A=step.F, B=step.G, dt=dt), design)


@knows_arguments(Ts='dt', A='F', B='G')
def dlqr(
    F: Any,
    G: ArrayLike | None = None,
    Q: ArrayLike | None = None,
    R: ArrayLike | None = None,
    N: ArrayLike | None = None,
    *,
    dt: float | None = None,
) -> StateFeedback:
    """Return the gain that minimises the sum of x'Q x + 2 x'N u + u'R u along x' = F x + G u.

    Errors are those of `lqr`.

    Parameters
    ----------
    F, G
        Of a step; or a system alone, ``dlqr(system, Q, R)``.
    Q, R, N
        Weights (n, n), (m, m) and (n, m).
    dt
        The sample time in seconds, 1 by default; it affects only the delay margin and frequencies.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kr.dlqr([[1, 0.1], [0, 1]], [0.005, 0.1], 1, 1).K.round(4)
    array([[0.9171, 1.6356]])
    """
    refuse_continuous('F', F)
    G, Q, R, N = shifted(F, (G, Q, R, N))
    process = plant(F, G)
    process = replace(process, dt=sample_time(process, dt) or 1.0)
    with _named():
        return _optimal(process, regulation.dlqr(process.A, process.B, _cost(process, Q, R, N)))


@contextmanager
def _named() -> Iterator[None]:
    """Have errors name the weights as these functions do."""
    try:
        yield
    except DesignError as error:
        text = str(error).replace('input_cost', 'R').replace('state_cost', 'Q')
        raise DesignError(text) from None


def _cost(plant: Plant, Q: Any, R: Any, N: Any) -> regulation.Cost:
    """Return weights; in discrete time R may be semi-definite, where Q weighs the input, too."""
    n, m = plant.B.shape
    if not m:
        raise ValueError('B: expected at least one input, got a system without')
    cross = None if N is None else columns('N', N, n)
    definite = plant.dt is None
    Q, R = weight('Q', Q, n), weight('R', R, m, definite=definite)
    try:
        return regulation.cost(Q, R, (n, m), cross, definite=definite)
    except ValueError as error:
        raise ValueError(f'N: {error}') from None


def _optimal(plant: Plant, design: regulation.LqrDesign) -> StateFeedback:
    return StateFeedback(plant, design.gain, design.poles, design.cost_to_go)


@knows_arguments(p='poles', P='poles', method='none: one method places poles', Ts='dt')
def place(
    A: Any, B: ArrayLike | None = None, poles: Sequence[complex] | None = None,
    *, dt: float | None = None,
) -> StateFeedback:  # fmt: skip
    """Return the gain with the eigenvalues of A - B K at ``poles``: ``place(A, B, poles)``.

    For an observer pass A' and C', and transpose the result.

    Parameters
    ----------
    A, B
        Of dx/dt = A x + B u; or a system alone, ``place(model, poles)``.
    poles
        n numbers, complex ones in pairs; they may be equal. Those of a system in discrete time
        are z.
    dt
        Seconds for which the input is held. A pole s, in 1/s, becomes exp(s dt); a system in
        discrete time has its own.

    Raises
    ------
    ValueError
        If the number of poles is wrong, or a conjugate is missing.
    DesignError
        If the input does not move every mode.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kr.place([[0, 1], [0, 0]], [0, 1], [-1, -2]).K.round(4)
    array([[2., 3.]])
    """
    B, poles = shifted(A, (B, poles))
    process = plant(A, B)
    if poles is None:
        raise ValueError(f'poles: expected {len(process.A)} numbers, one a state, got nothing')
    dt = sample_time(process, dt)
    if dt is None or process.dt is not None:
        design = placement.place(process.A, process.B, poles)
        return StateFeedback(process, design.gain, design.poles)
    step = process.system.sampled(dt)
    design = placement.sampled_place(process.system.A, process.system.B, poles, dt)
    return StateFeedback(replace(process, A=step.F, B=step.G, dt=dt), design.gain, design.poles)


@knows_arguments(Ts='dt', K='C, with A and B: the gain of u = -K x')
def margins(
    A: Any,
    B: ArrayLike | None = None,
    C: ArrayLike | None = None,
    D: ArrayLike | None = None,
    *,
    dt: float | None = None,
) -> InputMargins | LoopMargins:
    """Return the margins of a loop L = C (s I - A)^-1 B + D, closed by u = -L u.

    ``margins(A, B, K)`` or ``margins(system, K)`` for a state feedback, ``margins(gain)`` for a
    result of `lqr` or `place`, ``margins(loop)`` for a loop as a whole, such as python-control's
    ``H * P``, also as a transfer function.

    Parameters
    ----------
    A, B, C, D
        Matrices of the loop, with as many outputs as inputs: C is the gain K of a state feedback.
        A may be a model or a system, which has B, or a gain.
    dt
        Seconds of a sample, if the matrices are those of a loop in discrete time.

    Returns
    -------
    InputMargins
        For a loop with one input; for several, one for each, with all others closed, and
        ``all_at_once`` for changes of all together. ``plot()`` draws Bode and Nyquist plots.

    Raises
    ------
    ValueError
        If sizes do not match.
    DesignError
        If the closed loop is not stable.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kr.margins([[0, 1], [0, 0]], [0, 1], [1, 1.7])
    gain 0 to inf, lead any, lag 71.8 deg, delay 0.7 s, disk 1.3, min|1 + L| 1
    """
    if isinstance(A, StateFeedback):
        if any(given is not None for given in (B, C, D, dt)):
            raise ValueError('B: expected nothing beside a gain, which has its loop')
        by_input = A.margins
        return by_input[0] if len(by_input) == 1 else by_input
    loop = plant(A, B)
    if is_system(A):
        B, C, D = shifted(A, (B, C, D))
    if C is None and (system := read_system('A', A)) is not None:
        C, D = system.C, system.D
    dt = sample_time(loop, dt)
    C = rows('C', C, len(loop.A))
    if len(C) != loop.B.shape[1]:
        raise ValueError(f'C: expected a row for each of {loop.B.shape[1]} inputs, got {len(C)}')
    D = None if D is None else np.atleast_2d(numbers('D', D))
    by_input = LoopMargins.of(state_space(loop.A, loop.B, C, D, dt))
    return by_input[0] if len(by_input) == 1 else by_input


@knows_arguments(Ts='dt', T='dt', Q='W', method='none: the input is held, exactly')
def discretize(
    A: Any, B: ArrayLike | None = None, dt: float | None = None, W: ArrayLike | None = None
) -> Sampled:
    """Return F, G and Q of x' = F x + G u + w over ``dt`` seconds, exactly, with u held.

    ``F, G, Q, dt = discretize(A, B, dt, W)``; ``discretize(A, dt)`` without an input;
    ``discretize(model, dt)``, with the noise that the model has.

    Parameters
    ----------
    A, B
        Of dx/dt = A x + B u + w; or a model or a system alone.
    dt
        Seconds of a step.
    W
        Spectral density of w (n, n); none by default.

    Raises
    ------
    ValueError
        If a size is wrong or ``dt`` is not positive.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kr.discretize([[0, 1], [0, 0]], [0, 1], 0.1).G.ravel()
    array([0.005, 0.1  ])
    """
    if isinstance(A, Dynamics):
        check_still('A', A)
        seconds = duration('dt', B if dt is None else dt)
        model = A if A.is_discrete else linearize(A, *A.equilibrium)
        step = model.transition(*A.equilibrium, seconds)
        return Sampled.of((step.F, step.G, step.Q), seconds, plant(A))
    B, dt, W = shifted(A, (B, dt, W))
    if dt is None and B is not None and np.ndim(B) == 0:  # discretize(A, dt)
        B, dt = None, duration('dt', B)
    if not is_system(A):
        n = len(square('A', A))
        B = np.zeros((n, 0)) if B is None else B
    process, seconds = plant(A, B), duration('dt', dt)
    if process.dt is not None:
        raise ValueError(
            f'A: expected a system in continuous time, got one with samples of {process.dt:g} s'
        )
    density = np.zeros(process.A.shape) if W is None else weight('W', W, len(process.A))
    return Sampled.of(Discretization(process.A, process.B, density)(seconds), seconds, process)
