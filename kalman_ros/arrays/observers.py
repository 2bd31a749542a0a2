# SPDX-License-Identifier: Apache-2.0
"""Observer gains from arrays, in continuous and in sampled time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from kalman_ros.control import lqe as estimation
from kalman_ros.control.state_space import state_space
from kalman_ros.core import Array, Discretization, Dynamics, Sensor
from kalman_ros.core.known_arguments import knows_arguments

from .accept import columns, duration, numbered, rows, square, weight
from .foreign import Labels, labels_of, read_system
from .gain_results import Observer


@knows_arguments(QN='W', RN='V', NN='N', Q='W', R='V', H='C', Ts='dt')
def lqe(
    A: Any,
    G: Any = None,
    C: Any = None,
    W: Any = None,
    V: Any = None,
    N: Any = None,
    *,
    dt: float | None = None,
) -> Observer:
    """Return the steady-state Kalman filter of dx/dt = A x + G w, y = C x + v.

    ``lqe(A, C, W, V)``, or ``lqe(A, G, C, W, V)`` as in python-control, or ``lqe(model, sensor,
    dt=...)`` with one sensor or several that measure together. ``lqe(system, W, V, N)`` takes A, G
    and C from a state-space system of python-control or scipy.signal, whose noise acts where its
    input does.

    Parameters
    ----------
    A, G, C
        Matrices (n, n), (n, p) and (k, n); without G the noise acts on each state directly.
    W, V
        Spectral densities of w and v; with ``dt``, V is the covariance of one reading.
    N
        The cross density of w and v (p, k); only without ``dt``.
    dt
        Seconds between readings.

    Raises
    ------
    ValueError
        If a size is wrong, or W, V and N are no covariance.
    DesignError
        If the readings cannot keep the error of some mode bounded.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kr.lqe([[0, 1], [0, 0]], [1, 0], [0, 1], 1).L.round(4).ravel()
    array([1.4142, 1.    ])
    """
    if isinstance(A, Dynamics):
        return _of_model(A, G, dt)
    labels = labels_of(A)
    if (system := read_system('A', A)) is not None:
        if system.dt is not None:
            return dlqe(A, G, C, W, dt=dt)
        A, G, C, W, V, N = system.A, system.B, system.C, G, C, W
    if V is None and N is None:
        G, C, W, V = None, G, C, W
    A, G, C, W, V, N = _noises(A, G, C, W, V, N)
    density = G @ W @ G.T
    if dt is None:
        cross = None if N is None else G @ N
        return observer_of(A, C, estimation.lqe(A, C, density, V, cross), labels, None)
    if N is not None:
        raise ValueError('N: expected nothing where readings come in samples of dt')
    design = estimation.sampled_lqe(A, C, density, V, duration('dt', dt))
    F, _, _ = Discretization(A, np.zeros((len(A), 0)), density)(dt)
    return observer_of(F, C, design, labels, dt)


@knows_arguments(QN='Q', RN='R', NN='N', A='F', B='G', W='Q', V='R', H='C', Ts='dt')
def dlqe(
    F: Any,
    G: Any = None,
    C: Any = None,
    Q: Any = None,
    R: Any = None,
    N: Any = None,
    *,
    dt: float | None = None,
) -> Observer:
    """Return the steady-state Kalman filter of x' = F x + G w, y = C x + v, in samples.

    ``dlqe(F, C, Q, R)``, or ``dlqe(F, G, C, Q, R)`` and ``dlqe(system, Q, R)`` as in
    python-control. Errors are those of `lqe`.

    Parameters
    ----------
    F, G, C
        Matrices (n, n), (n, p) and (k, n); without G the noise acts on each state directly.
    Q, R
        Covariances of w (p, p) and v (k, k).
    N
        Covariance of w and v (p, k).
    dt
        Seconds between readings, 1 by default.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kr.dlqe([[1, 0.1], [0, 1]], [1, 0], [0, 0.1], 1).gain.round(4).ravel()
    array([0.2226, 0.2788])
    """
    if isinstance(F, Dynamics):
        return _of_model(F, G, dt)
    labels = labels_of(F)
    if (system := read_system('F', F)) is not None:
        if system.continuous:
            raise ValueError('F: expected a system in discrete time, got one in continuous time')
        F, G, C, Q, R, N = system.A, system.B, system.C, G, C, Q
        dt = system.dt if dt is None else dt
    if R is None and N is None:
        G, C, Q, R = None, G, C, Q
    F, G, C, Q, R, N = _noises(F, G, C, Q, R, N, definite=False)
    design = estimation.dlqe(F, C, G @ Q @ G.T, R, None if N is None else G @ N)
    return observer_of(F, C, design, labels, duration('dt', dt or 1.0))


def _noises(
    A: Any, G: Any, C: Any, W: Any, V: Any, N: Any, *, definite: bool = True
) -> tuple[Any, ...]:
    """Return the checked matrices; without G it is the identity."""
    A = square('A', A)
    n = len(A)
    G = np.eye(n) if G is None else columns('G', G, n)
    C = rows('C', C, n)
    W, V = weight('W', W, G.shape[1]), weight('V', V, len(C), definite=definite)
    return A, G, C, W, V, None if N is None else columns('N', N, len(W))


def _of_model(model: Dynamics, sensors: Any, dt: float | None) -> Observer:
    """Return the filter of a model, and one or several sensors, about its equilibrium."""
    several = list(sensors.values()) if isinstance(sensors, Mapping) else sensors
    several = [several] if isinstance(several, Sensor) else list(several or ())
    if not several or not all(isinstance(sensor, Sensor) for sensor in several):
        raise ValueError('sensors: expected one or several, as in lqe(model, sensor, dt=...)')
    if model.is_discrete:
        dt = model.period if dt is None else dt
    if dt is None:
        raise ValueError('dt: expected the seconds between readings of the sensors, got nothing')
    x, u = model.equilibrium
    step = model.transition(x, u, duration('dt', dt))
    C = np.vstack([sensor.jacobian(x) for sensor in several])
    R = np.zeros((len(C), len(C)))
    at = 0
    for sensor in several:
        k = sensor.output.size
        R[at : at + k, at : at + k] = sensor.covariance
        at += k
    design = estimation.dlqe(step.F, C, step.Q, R)
    readings = tuple(name for sensor in several for name in sensor.output.names)
    unique = readings if len({*readings}) == len(readings) else None
    return observer_of(step.F, C, design, Labels(model.state.names, None, unique), dt)


def observer_of(
    A: Array, C: Array, design: estimation.LqeDesign, labels: Labels, dt: float | None
) -> Observer:
    """Return the filter with its response, x = (s I - A + L C)^-1 L y, or that after a reading."""
    states, readings = labels.states or numbered('x', len(A)), labels.readings
    L, n = design.predictor_gain, len(A)
    after = np.eye(n), np.zeros(L.shape)
    if dt is not None:
        after = np.eye(n) - design.gain @ C, design.gain
    return Observer(
        **vars(design), states=states, readings=readings or numbered('y', len(C)), dt=dt,
        response=state_space(A - L @ C, L, *after, dt=dt),
    )  # fmt: skip
