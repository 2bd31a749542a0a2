# SPDX-License-Identifier: Apache-2.0
"""A closed loop in this process: plant, estimator and the controller node's regulator."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from math import inf
from pathlib import Path
from typing import Any, Union

import numpy as np

from kalman_ros import scenario as scenarios
from kalman_ros.control.feedback import Feedback, Regulator
from kalman_ros.control.limiter import Limiter
from kalman_ros.core import (
    Array,
    ArrayLike,
    DiscreteModel,
    OperatingPoint,
    matrix,
    refuse_unknown,
    vector,
)
from kalman_ros.scenario import Scenario
from kalman_ros.scenario import regulator as regulators
from kalman_ros.simulation import closed_loop
from kalman_ros.simulation.trajectory import Trajectory

from . import text
from .accept import duration, numbers
from .estimates import _path
from .gains import dlqr
from .known_names import KnownNames
from .scenarios import BELIEVED, load, values_of

#: A state (n,), or some of its coordinates by name; or a function of time that returns either.
Reference = Union[ArrayLike, Mapping[str, float], Callable[[float], Any], None]
#: The pictures of a run.
PICTURES = ('overview', 'states', 'errors', 'innovations', 'force')


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedRun(KnownNames, Trajectory):
    """A run of a loop, step by step, with the scenario that it is of; it prints and draws itself.

    Parameters
    ----------
    scenario
        The simulated scenario.
    limited
        The number of steps in which a limit changed the input.
    """

    scenario: Scenario
    limited: int

    def __repr__(self) -> str:
        scenario, steps = self.scenario, len(self.time)
        state, input = scenario.model.state, scenario.model.input
        error = state.subtract(self.truth, self.estimate)
        rms = np.sqrt(np.mean(error**2, axis=0)).tolist()
        claimed = np.sqrt(self.covariance.diagonal(axis1=1, axis2=2).mean(axis=0)).tolist()
        law = f', law {scenario.law}' if scenario.law else ''
        lines = [
            f'{type(scenario.model).__name__} for {self.time[-1]:g} s at {scenario.rate:g} Hz, '
            f'filter {scenario.filter}{law}'
        ]
        cells = (
            [state.label(name), *map(text.number, (self.truth[-1, i].item(), rms[i], claimed[i]))]
            for i, name in enumerate(state.names)
        )
        lines += text.table(['', 'at the end', 'RMS error', 'claimed'], cells)
        for index, name in enumerate(input.names):
            u = self.input[:, index]
            lines.append(
                f'{input.label(name)}: RMS {np.sqrt(np.mean(u**2)):.4g}, '
                f'largest {np.abs(u).max():.4g}'
            )
        if self.limited:
            lines.append(f'a limit changed the input in {self.limited} of {steps} steps')
        return '\n'.join(lines)

    def plot(self, path: str | Path | None = None, what: str = 'overview') -> Any:
        """Draw the ``'overview'``, ``'states'``, ``'errors'``, ``'innovations'`` or ``'force'``.

        Returns
        -------
        The axes of a figure of matplotlib, which a notebook shows and ``plt.show()`` opens; with a
        ``path`` the figure is saved there instead, and closed.
        """
        from kalman_ros.report import run_pictures  # matplotlib is slow to load

        refuse_unknown([what], PICTURES, 'picture')
        if what == 'force' and not self.scenario.model.input.size:
            raise ValueError('plot: there is no force, for the model has no input')
        return getattr(run_pictures, what)(self.scenario, self, _path(path))


def simulate(
    scenario: Scenario | str | Path | Mapping[str, Any] = 'mass_spring_damper_2d',
    overrides: Mapping[str, Any] | None = None,
    *,
    seconds: float = 10.0,
    seed: int = 0,
    reference: Reference = None,
    gain: ArrayLike | None = None,
    input_limit: ArrayLike | None = None,
    input_rate_limit: ArrayLike | None = None,
) -> SimulatedRun:
    """Return the run of a loop: plant, estimator and regulator in this process, as in lockstep.

    The regulator is that of the controller node: the law of the scenario (lqr, placement, lqi),
    its limits and references.

    Parameters
    ----------
    scenario, overrides
        As for `load`; plant, estimator and controller each use their section of a file, so the
        plant may differ from their model.
    seconds
        How long.
    seed
        Of all noise.
    reference
        The state to hold: (n,), or some of it by name, ``{'x': 1.0}``, the rest at the
        equilibrium; or a function of the time in seconds that returns either.
    gain
        K (m, n), instead of the scenario's law.
    input_limit, input_rate_limit
        The largest input, and its largest change per second; one number for all inputs.

    Raises
    ------
    ValueError
        If an argument is invalid, or no input holds the reference.
    DesignError
        If the law has no solution.
    """
    real, believed, values = _scenarios(scenario, overrides)
    seconds = duration('seconds', seconds)
    if not isinstance(seed, (int, np.integer)) or seed < 0:
        got = repr(seed) if isinstance(seed, (int, str)) else type(seed).__name__
        raise ValueError(f'seed: expected a whole number from 0, got {got}')
    limits = regulators.limits(
        believed,
        *(
            numbers(name, values.get(name, inf) if given is None else given).ravel()
            for name, given in (
                ('input_limit', input_limit),
                ('input_rate_limit', input_rate_limit),
            )
        ),
    )
    if not real.model.input.size:
        for name, value in {'reference': reference, 'gain': gain}.items():
            if value is not None:
                raise ValueError(f'{name}: expected none, for the model has no input')
        return _run(closed_loop.run(real, None, seconds, seed, believed=believed), believed, 0)
    model = believed.model
    regulator = Regulator(model.state, _feedback(believed, gain), model.equilibrium)
    limiter = Limiter(limits, np.zeros(model.input.size))
    answer = _Answer(believed, regulator, limiter, reference)
    found = closed_loop.run(real, None, seconds, seed, believed=believed, answer=answer)
    return _run(found, believed, limiter.limited)


def _run(found: Trajectory, scenario: Scenario, limited: int) -> SimulatedRun:
    values = {field.name: getattr(found, field.name) for field in fields(Trajectory)}
    return SimulatedRun(**values, scenario=scenario, limited=limited)


def _scenarios(
    given: Any, overrides: Mapping[str, Any] | None
) -> tuple[Scenario, Scenario, Mapping[str, Any]]:
    """Return the plant's scenario, the estimator's, and the values of the controller."""
    if isinstance(given, Scenario):
        return load(given, overrides), given, {}
    values = values_of(given, {} if overrides is None else overrides, *BELIEVED)
    return load(given, overrides), scenarios.build(values), values


def _feedback(scenario: Scenario, gain: Any) -> Feedback:
    """Return the gains of the argument, else those of the scenario's law."""
    model = scenario.model
    n, m = model.state.size, model.input.size
    if gain is not None:
        K = matrix('gain', numbers('gain', gain), (m, n))
    elif isinstance(model, DiscreteModel):
        if scenario.law != 'lqr':
            raise ValueError(f'law: expected lqr or a gain in discrete time, got {scenario.law}')
        K = dlqr(model, scenario.state_cost, scenario.input_cost).gain
    else:
        return regulators.feedback(scenario)
    return Feedback(K, np.empty((m, 0)), (), np.empty(0, dtype=complex))


class _Answer:
    """The input for each estimate, as from the controller node in lockstep."""

    def __init__(
        self, scenario: Scenario, regulator: Regulator, limiter: Limiter, reference: Reference
    ) -> None:
        self._scenario, self._regulator, self._limiter = scenario, regulator, limiter
        self._reference: Any = reference
        self._last: int | None = None
        self._wanted: Array | None = None
        if reference is not None:
            self._equilibria = regulators.tracking(scenario)
            self._follow(0.0)

    def __call__(self, time: int, x: Array) -> Array:
        if callable(self._reference):
            self._follow(time * 1e-9)
        dt = 0.0 if self._last is None else (time - self._last) * 1e-9
        self._last = time
        wanted = self._regulator.propose(x, dt)
        u = self._limiter.toward(wanted, dt or 1.0 / self._scenario.rate)
        self._regulator.applied(x, wanted, u, dt)
        return u

    def _follow(self, time: float) -> None:
        """Hold the reference of a time; nothing changes while it stays the same."""
        given = self._reference(time) if callable(self._reference) else self._reference
        wanted = self._state(given)
        if self._wanted is None or not np.array_equal(wanted, self._wanted):
            self._wanted = wanted
            self._regulator.target = self._target(wanted)

    def _target(self, wanted: Array) -> OperatingPoint:
        return regulators.target(self._scenario, self._equilibria, wanted)

    def _state(self, given: Any) -> Array:
        space, rest = self._scenario.model.state, self._scenario.model.equilibrium.state
        if not isinstance(given, Mapping):
            return vector('reference', given, space.size)
        wanted: Array = rest.copy()
        wanted[space.indices(given, 'reference')] = vector('reference', [*given.values()])
        return wanted
