# SPDX-License-Identifier: Apache-2.0
"""The formulas of a model, a sensor and a space: what a filter calls in each step."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, NamedTuple

import casadi
import numpy as np

from kalman_ros.core import Array, DiscreteModel, Dynamics, Model, Sensor, Space
from kalman_ros.core.model import MOST_SUBSTEPS, numerical_jacobian

from .free_parameters import Parameters
from .symbols import by_ways
from .tracing import Trace, agree, trace
from .untraceable import UntraceableError

#: A Jacobian that is coded by hand, or numerical, may differ this much from the exact one.
_CLOSE = 1e-5
#: Seeds of states and of inputs, which must not be alike.
_OF_STATES, _OF_INPUTS = 0, 1
#: Distances of points from the rest, and how many of each.
_DISTANCES, _COUNTS = (0.3, 1.0, 3.0, 10.0, 100.0, 1000.0), (8, 8, 8, 2, 2, 2)
#: How many of all points are near, and by how much a compiled value may differ there.
_NEAR, _EXACT = 25, 1e-8
#: A step in seconds in which noise adds its density times the step.
_SHORT = 1e-9
_PACKAGE = __name__.partition('.')[0]


#: Functions of models that compiled steps do not call.
_OF_STEPS = ('substeps', 'transition', 'linearized_step', 'noise_covariance', 'differenced_step')
_OF_PERIODS = ('step', 'transition', 'linearized_step', 'noise_covariance')


def overridden(model: Dynamics, functions: Iterable[str] = ('step', *_OF_STEPS)) -> set[str]:
    """Return those of some functions that the class of a user defines in another way."""
    kind = type(model)
    return {
        name for name in functions if not getattr(kind, name).__module__.startswith(f'{_PACKAGE}.')
    }


def nested(model: Model) -> list[Model]:
    """Return a model and those among its attributes."""
    inner = [value for value in vars(model).values() if isinstance(value, Model)]
    return [model, *(part for one in inner for part in nested(one))]


class ModelFormulas(NamedTuple):
    """What `Model.step` and `Model.linearized_step` are made of, for numbers p of the model.

    Parameters
    ----------
    derivative
        dx/dt of x, u and p.
    substep
        x' of x, u, h and p.
    wrap
        The state x with its angles and rotations as they are stored.
    jacobian
        A of x, u and p.
    density
        W of x and p.
    slope
        The F of a substep, of x, u, h and p; only for a model without a Jacobian, whose F is the
        derivative of its step.
    most
        The most substeps of a step.
    """

    derivative: Trace
    substep: Trace
    wrap: Trace
    jacobian: Trace
    density: Trace
    slope: Trace | None
    most: int

    @property
    def traces(self) -> dict[str, Trace]:
        """The functions by name."""
        return {name: value for name, value in self._asdict().items() if isinstance(value, Trace)}


class DiscreteModelFormulas(NamedTuple):
    """Functions of a model in discrete time that its steps call, for numbers p of the model.

    Parameters
    ----------
    substep
        The state x' after a period, of x, u and p; not wrapped.
    wrap
        The state x with its angles and rotations as they are stored.
    slope
        F of x, u and p.
    density
        Q of a period, of x and p.
    period
        Seconds from one step to the next, of p.
    """

    substep: Trace
    wrap: Trace
    slope: Trace
    density: Trace
    period: Trace


class SensorFormulas(NamedTuple):
    """What a sensor is made of: the reading, and H, of x and p."""

    measure: Trace
    jacobian: Trace


class SpaceFormulas(NamedTuple):
    """What a space with rotations is made of.

    Parameters
    ----------
    arrived
        The mean, and behind it the covariance, of total, origin and P (n * n,).
    difference
        A - b, of a and b.
    """

    arrived: Trace
    difference: Trace


def _points(center: Array, scale: float = 0.3, count: int = 3, seed: int = 0) -> Array:
    """Return points (count, n) about one, without symmetry."""
    return center + scale * np.random.default_rng(seed).standard_normal((count, len(center)))


def _far(center: Array, seed: int = _OF_STATES) -> Array:
    """Return points at all distances from one, and the point itself at first (31, n)."""
    scales = np.repeat(_DISTANCES, _COUNTS)[:, np.newaxis]
    moved = scales * np.random.default_rng(seed).standard_normal((len(scales), len(center)))
    return np.vstack((center, center + moved))


def points_about(model: Dynamics) -> tuple[Array, Array]:
    """Return states (3, n) and inputs (3, m) about the equilibrium of a model."""
    rest = model.equilibrium
    return _points(rest.state), _points(rest.input, seed=_OF_INPUTS)


def _branching(model: Any, function: str) -> Any:
    """Return a model that merges the ways through a function, its own or an inner model's.

    A step calls it several times, and ways multiply.
    """
    for inner in nested(model):
        vars(inner)[function] = partial(by_ways, getattr(inner, function))
    return model


def _undivided(model: Any) -> Any:
    """Return a model that refuses to divide a step: its length is no number in formulas."""

    def substeps(dt: Any) -> int:
        raise UntraceableError('its step is divided into substeps')

    for inner in nested(model):
        vars(inner)['substeps'] = substeps
    return model


def of_model(model: Model, parameters: Parameters) -> ModelFormulas:
    """Return the formulas of a model in continuous time.

    Raises
    ------
    UntraceableError
        If a function cannot be traced, or its own Jacobian is not the derivative.
    """
    for name in _OF_STEPS:
        if any(name in overridden(part) for part in nested(model)):
            raise UntraceableError(f'its class defines {name}')
    space = model.state

    def given(p: Any) -> Any:
        return _branching(parameters.applied(p), 'derivative')

    n, p, e = space.size, parameters.values, np.zeros(space.size)
    states, inputs = points_about(model)
    steps = np.array([[0.01], [0.002], [-0.001]])
    probes = [(x, u, h, p) for x, u, h in zip(states, inputs, steps)]
    substep, most = _of_steps(model, given, probes)
    rates = trace(
        lambda x, u, p, e: given(p).derivative(space.reached(x + e, x), u),
        *((x, u, p, e) for x, u in zip(states, inputs)),
    )
    turned = trace(
        lambda slope, rate: space.of_errors(slope.reshape(n, n), rate), (np.zeros(n * n), e)
    )
    by_state = rates.slope(3, np.zeros(n))
    derivative = rates.at(3, np.zeros(n))
    jacobian = turned.at(1, derivative.result).at(0, casadi.vec(casadi.densify(by_state.result).T))
    jacobian = Trace(by_state.variables, jacobian.result)
    agree(
        jacobian,
        lambda x, u, p: given(p).state_jacobian(x, u),
        [(x, u, p) for x, u in zip(states, inputs)],
        _CLOSE,
        'its state_jacobian is not that of its derivative',
    )
    density = trace(lambda x, p: given(p).noise_density(x), *((x, p) for x in states))
    wrap = trace(space.wrap, *((4.0 * x,) for x in states))
    slope = None if model.analytic else _slope(space, substep)
    return ModelFormulas(derivative, substep, wrap, jacobian, density, slope, most)


def of_discrete_model(model: DiscreteModel, parameters: Parameters) -> DiscreteModelFormulas:
    """Return the formulas of a model in discrete time.

    Raises
    ------
    UntraceableError
        If a function cannot be traced, or its Jacobian is not the derivative.
    """
    for name in sorted(overridden(model, _OF_PERIODS)):
        raise UntraceableError(f'its class defines {name}')
    space, given, p = model.state, parameters.applied, parameters.values
    states, inputs = points_about(model)
    probes = [(x, u, p) for x, u in zip(states, inputs)]
    substep = trace(lambda x, u, p: given(p).next(x, u), *probes)
    slope = _slope(space, substep)
    agree(
        slope,
        lambda x, u, p: given(p).next_jacobian(x, u)[0],
        probes,
        _CLOSE,
        'its next_jacobian is not that of its next',
    )
    return DiscreteModelFormulas(
        substep,
        trace(space.wrap, *((4.0 * x,) for x in states)),
        slope,
        trace(lambda x, p: given(p).noise(x), *((x, p) for x in states)),
        trace(lambda p: np.array([given(p).period]), (p,)),
    )


def _of_steps(
    model: Model, given: Callable[[Any], Model], probes: Sequence[Sequence[Array]]
) -> tuple[Trace, int]:
    """Return the formula of a substep, not wrapped, and the most of them in a step.

    A model that overrides ``step`` has one in each.
    """
    if any('step' in overridden(part) for part in nested(model)):
        return trace(lambda x, u, h, p: _undivided(given(p)).step(x, u, h[0]), *probes), 1
    substep = trace(lambda x, u, h, p: given(p).substep(x, u, h[0]), *probes)
    x, u, _, p = probes[0]
    longer = 2.5 * min(model.max_step, 0.1)
    h, most = longer / model.substeps(longer), MOST_SUBSTEPS
    evaluated = substep.function('f')
    moved = x
    for _ in range(model.substeps(longer)):
        moved = np.array(evaluated(moved, u, h, p))[:, 0]
    if np.allclose(model.state.wrap(moved), model.step(x, u, longer), rtol=_CLOSE, atol=_CLOSE):
        return substep, most
    raise UntraceableError('its steps are not those of its substeps')


def _slope(space: Space, substep: Trace) -> Trace:
    """Return the derivative of a substep by the error of its start."""
    n = space.size
    apart = trace(
        lambda x, e, y, y_0: np.concatenate((space.reached(x + e, x), space.subtract(y, y_0))),
        (np.full(n, 0.3), np.zeros(n), np.full(n, 0.2), np.full(n, 0.2)),
    )
    x, e, y, y_0 = apart.variables
    disturbed, change = casadi.vertsplit(casadi.densify(apart.result), [0, n, 2 * n])
    v, *rest = substep.variables
    (start,) = casadi.substitute([disturbed], [x], [v])
    (end,) = casadi.substitute([substep.result], [v], [start])
    (error,) = casadi.substitute([change], [y, y_0], [end, substep.result])
    return Trace([v, e, *rest], error).slope(1, np.zeros(n))


def of_sensor(sensor: Sensor, space: Space, parameters: Parameters) -> SensorFormulas:
    """Return the formulas of a sensor of states in a space.

    Raises
    ------
    UntraceableError
        If a function cannot be traced, or its own Jacobian is not the derivative.
    """
    given, output, p = parameters.applied, sensor.output, parameters.values
    n, k = space.size, output.size
    states = _points(np.full(n, 0.5))
    measure = trace(lambda x, p: given(p).measure(x), *((x, p) for x in states))
    changes = trace(
        lambda x, p, e, y: output.subtract(given(p).measure(space.reached(x + e, x)), y),
        *((x, p, np.zeros(n), np.zeros(k)) for x in states),
    )
    slope = changes.slope(2, np.zeros(n))
    jacobian = slope.at(
        2, casadi.substitute([measure.result], measure.variables, slope.variables[:2])[0]
    )
    agree(
        jacobian,
        lambda x, p: given(p).jacobian(x),
        [(x, p) for x in states],
        _CLOSE,
        'its jacobian is not that of its measure',
    )
    return SensorFormulas(measure, jacobian)


def of_space(space: Space) -> SpaceFormulas:
    """Return the formulas of a space.

    Raises
    ------
    UntraceableError
        If they cannot be traced.
    """
    n = space.size
    a, b, P = (_points(np.zeros(size), seed=seed) for seed, size in enumerate((n, n, n * n)))

    def arrived(total: Array, origin: Array, P: Array) -> Array:
        mean, covariance = space.arrived(total, origin, P.reshape(n, n))
        return np.concatenate((mean, covariance.ravel()))

    return SpaceFormulas(trace(arrived, *zip(a, b, P)), trace(space.subtract, *zip(a, b)))


def verify(
    original: Dynamics | Sensor, compiled: Any, state: Space, *, one_of_many: bool = False
) -> None:
    """Raise UntraceableError where a compiled part does not do what the original does.

    Of ``one_of_many`` that differ in numbers, fewer points are compared.
    """
    if isinstance(original, Dynamics):
        _verify_model(original, compiled, 1 if one_of_many else None)
    else:
        _verify_sensor(original, compiled, state, 1 if one_of_many else None)


def _verify_model(original: Dynamics, compiled: Dynamics, near: int | None) -> None:
    """Compare a model at some points ``near`` its rest, or at all, and at others far away."""
    states, inputs = points_about(original)
    dt = original.period or 0.01
    for x, u in zip(states[:near], inputs):
        _verify(partial(_linearized, original), compiled.linearized_step, x, u, dt)
    rest = original.equilibrium
    far, inputs = _far(rest.state), _far(rest.input, _OF_INPUTS)
    every = 3 if near else 1
    for some, close in ((slice(0, _NEAR, every), _EXACT), (slice(_NEAR, None), _CLOSE)):
        _verify(
            lambda x, u: (original.time_derivative(x, u), original.step(x, u, dt)),
            lambda x, u: (compiled.time_derivative(x, u), compiled.step(x, u, dt)),
            far[some],
            inputs[some],
            close=close,
        )
    rows = [
        0,
        *range(_NEAR - 1, len(far), 2 if near else 1),
    ]  # noise that changes does so far away
    for x, u in zip(far[rows], inputs[rows]):
        short = original.period or _short(original, x, u)
        if short:
            _verify(
                lambda x: (original.noise_density(x),),
                lambda x, u=u, short=short: (compiled.noise_covariance(x, u, short) / short,),
                x,
            )


def _linearized(model: Any, x: Array, u: Array, dt: float) -> Iterable[Array]:
    """Return a step, F and Q of a model; without a Jacobian, by differences over short ways.

    Those of a step are over longer ones, which are wrong where a derivative changes quickly.
    """
    if model.is_discrete or model.analytic:
        step: Iterable[Array] = model.linearized_step(x, u, dt)
        return step
    F = numerical_jacobian(
        lambda points: model.step(points, u, dt), x, model.state.subtract, model.state
    )
    return model.step(x, u, dt), F, model.noise_covariance(x, u, dt)


def _short(model: Any, x: Array, u: Array) -> float:
    """Return a step in which nothing but the noise adds to Q; 0 where there is none."""
    try:
        with np.errstate(all='ignore'):
            rate = float(np.abs(model.state_jacobian(x, u)).sum())
    except Exception:  # a function of a user may fail where no state is
        return 0.0
    return _SHORT / max(1.0, rate) if np.isfinite(rate) else 0.0


def _verify_sensor(original: Sensor, compiled: Sensor, state: Space, near: int | None) -> None:
    """Compare a sensor of a state, with its derivatives at some points."""
    states = _points(np.full(state.size, 0.5))
    for x in states[:near]:
        _verify(
            lambda at: (original.measure(at), original.jacobian(at)),
            lambda at: (compiled.measure(at), compiled.jacobian(at)),
            x,
        )
    far = _far(np.full(state.size, 0.5))
    for some, close in ((slice(_NEAR), _EXACT), (slice(_NEAR, None), _CLOSE)):
        _verify(
            lambda at: (original.measure(at),), lambda at: (compiled.measure(at),),
            far[some], close=close,
        )  # fmt: skip


def _verify(
    original: Callable[..., Iterable[Array]],
    compiled: Callable[..., Iterable[Array]],
    *at: Any,
    close: float = _CLOSE,
) -> None:
    """Compare functions at a point, or at several at once, or one by one where that fails."""
    with np.errstate(all='ignore'):
        try:
            expected = [*original(*at)]
        except Exception:  # a function of a user may fail on arrays, or where no state is
            if at[0].ndim == 2:
                for point in zip(*at):
                    _verify(original, compiled, *point, close=close)
            return
        pairs = [*zip(compiled(*at), expected)]
    for mine, theirs in pairs:
        known = np.isfinite(theirs)  # where there is no number, filters fail either way
        size = np.abs(theirs[known])
        least = close * (size + size.max(initial=0.0))
        if not np.all(np.abs(mine[known] - theirs[known]) <= least):
            raise UntraceableError('its compiled functions are not what it computes')
