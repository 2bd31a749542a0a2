# SPDX-License-Identifier: Apache-2.0
"""Parameters from arrays of readings, by maximum likelihood."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Union

import numpy as np

from kalman_ros.analysis.tuning.candidate import Candidate
from kalman_ros.analysis.tuning.fit import Fit, Fitted, fit
from kalman_ros.analysis.tuning.free_parameter import FreeParameter
from kalman_ros.analysis.tuning.held_out import Judgement, judge
from kalman_ros.analysis.tuning.likelihood import Likelihood
from kalman_ros.analysis.tuning.named_parameters import NamedParameters
from kalman_ros.analysis.tuning.observations import Observations, Readings
from kalman_ros.analysis.tuning.walk import Conditions
from kalman_ros.core import Array, ArrayLike, TimedSensor, refuse_unknown
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.filter import Plan
from kalman_ros.estimators.policy import Policy

from . import text
from .accept import belief_of, got, number
from .filtering import _inputs
from .known_names import KnownNames
from .passing import Task, _limits
from .rows import Rows, readings_of, sensors_of
from .scenarios import values_of

#: A scenario by name, file or parameters; or a function of the parameters that returns a model
#: and its sensors, and perhaps the first belief.
Problem = Union[str, Path, Mapping[str, Any], Callable[..., tuple[Any, ...]]]
#: Correlations that are mentioned.
_NOTABLE = 0.5


@dataclass(frozen=True, eq=False, repr=False)
class Tuning(KnownNames):
    """Fitted parameters; it prints itself.

    Parameters
    ----------
    parameters
        By name: start, value, 95 % interval, and why one is not determined.
    correlation
        Between the errors of the parameters (p, p); NaN where one is not determined.
    log_likelihood
        Before and after the fit.
    aic
        Akaike's information criterion before and after; lower is better.
    converged
        Whether the maximum was reached.
    held_out
        What the filter makes of the readings that were held out, before and after the fit; None
        if there are none.
    """

    parameters: Mapping[str, Fitted]
    correlation: Array
    log_likelihood: tuple[float, float]
    aic: tuple[float, float]
    converged: bool
    held_out: tuple[Judgement, Judgement] | None
    count: int

    @property
    def values(self) -> dict[str, float]:
        """The fitted values; of those that are not determined, one choice of many."""
        return {name: each.value for name, each in self.parameters.items()}

    @property
    def undetermined(self) -> dict[str, str]:
        """Why, by the name of each parameter that the data do not determine."""
        return {name: each.reason for name, each in self.parameters.items() if each.reason}

    def __repr__(self) -> str:
        p = len(self.parameters)
        lines = [f'{p} parameter{"" if p == 1 else "s"} fitted to {self.count} readings']
        rows = []
        for name, each in self.parameters.items():
            label = f'{name} [{each.unit}]' if each.unit else name
            known = each.determined
            interval = f'{each.low:.4g} to {each.high:.4g}' if known else 'not determined'
            rows.append([label, f'{each.start:.4g}', f'{each.value:.4g}' if known else '',
                         interval])  # fmt: skip
        lines += text.table(['', 'start', 'fitted', '95 % interval'], rows)
        for name, reason in self.undetermined.items():
            lines += text.sentence(f'{name}: {reason}')
        names = list(self.parameters)
        for i in range(p):
            for j in range(i):
                r = self.correlation[i, j]
                if abs(r) > _NOTABLE:
                    lines += text.sentence(f'{names[j]} and {names[i]}: correlation {r:+.2f}')
        pairs = (('log-likelihood', self.log_likelihood), ('AIC', self.aic))
        lines += [f'{name}: {a:.6g} before, {b:.6g} after' for name, (a, b) in pairs]
        if not self.converged:
            lines.append('not converged: what was reached so far')
        if self.held_out is not None:
            before, after = self.held_out
            gain = after.log_likelihood - before.log_likelihood
            verdict = 'consistent' if after.consistent else 'not consistent'
            lines.append(f'readings held out: log-likelihood {gain:+.4g}, {verdict}')
        return '\n'.join(lines)


def tune(
    problem: Problem,
    times: Any = None,
    readings: Any = None,
    inputs: ArrayLike | None = None,
    initial: Any = None,
    *,
    fit: Sequence[str] | Mapping[str, float] | str | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    linear: Sequence[str] = (),
    filter: str = '',
    input_times: ArrayLike | None = None,
    gates: float | Mapping[str, float] | None = None,
    hold_out: float = 0.0,
) -> Tuning:
    """Return the parameters that explain readings best: ``tune(problem, times, readings)``.

    They maximise the likelihood of the innovations of a filter, times the priors if there are
    any, from several starts. Intervals are those of the Fisher information.

    Parameters
    ----------
    problem
        A scenario by name, file or parameters; or a function whose keyword arguments are the
        parameters, and which returns a model and its sensors, and perhaps the first belief.
    times, readings, inputs, initial, input_times, gates
        As for `filter`.
    fit
        The names to fit, those of the scenario's file, or for a function their starts:
        ``{'mass': 1.0}``. By default all noise of a scenario, and all arguments of a function
        that have a default.
    bounds
        Low and high by name.
    priors
        By name what is known before: mean and standard deviation.
    linear
        Of a function: parameters that may be negative. Others that start above 0 are positive,
        and fitted on a logarithmic scale.
    filter
        ``'kf'``, ``'ekf'`` or ``'ukf'``; by default the scenario's, or the simplest that serves.
    hold_out
        The share of the readings, the last ones, that are kept to judge the fit.

    Raises
    ------
    ValueError
        If an argument is invalid, or there is no likelihood; the message names it.
    """
    share = number('hold_out', hold_out)
    if not 0.0 <= share < 1.0:
        raise ValueError(f'hold_out: expected a share from 0 to below 1, got {share:g}')
    if callable(problem):
        made: _FunctionProblem | _ScenarioProblem = _FunctionProblem(
            problem, fit, bounds or {}, priors or {}, linear, initial, filter
        )
    else:
        made = _ScenarioProblem(problem, fit, bounds or {}, priors or {}, initial, filter)
    task = made.task()
    rows = readings_of(times, readings, task.sensors, task.model)
    if not any(np.isfinite(each.values).any() for each in rows.values()):
        raise ValueError('readings: expected at least one finite number, got none')
    acts = _inputs(task.model, inputs, input_times, times, rows)
    observations = _observations(rows, acts)
    limits = _limits(gates, task.sensors, {name: name for name in task.sensors})
    policy = Policy(window=0.0, max_gap=0.0, restart_after=0, gates=limits)
    until = observations.until(1.0 - share) if share else None
    likelihood = Likelihood(
        made.parameters, made.candidate, observations,
        Conditions(policy, np.zeros(task.model.input.size)), until,
    )  # fmt: skip
    return tuning(likelihood)


def tuning(likelihood: Likelihood) -> Tuning:
    """Return the fit of a likelihood, judged on the readings after its end."""
    found: Fit = fit(likelihood)
    held = None
    if likelihood.until is not None:
        starts = {each.name: each.start for each in likelihood.parameters}
        held = (
            judge(likelihood, starts, likelihood.until),
            judge(likelihood, found.values, likelihood.until),
        )
    return Tuning(
        {each.name: each for each in found.parameters}, found.correlation,
        (found.before, found.after), found.aic, found.converged, held, found.count,
    )  # fmt: skip


def _observations(rows: Mapping[str, Rows], acts: Rows) -> Observations:
    readings = {
        name: Readings(np.asarray(each.stamps, dtype=np.int64), each.values)
        for name, each in rows.items()
    }
    return Observations(readings, np.asarray(acts.stamps, dtype=np.int64), acts.values)


class _ScenarioProblem:
    """The parameters of a scenario."""

    def __init__(
        self,
        given: Any,
        names: Any,
        bounds: Mapping[str, tuple[float, float]],
        priors: Mapping[str, tuple[float, float]],
        initial: Any,
        filter: str,
    ) -> None:
        values = values_of(given, {'filter': filter} if filter else {}, 'estimator')
        self._named = NamedParameters(values)
        if isinstance(names, Mapping):
            raise ValueError('fit: expected the names of parameters; their starts are those of '
                             'the scenario')  # fmt: skip
        wanted = [names] if isinstance(names, str) else names or self._named.usual
        self.parameters = self._named.choose(list(wanted), bounds, priors)
        model = self._named.scenario.model
        self._initial = None if initial is None else belief_of(initial, model)

    def task(self) -> Task:
        """Return the model, sensors and belief at the start."""
        found = self._named.scenario
        sensors = {name: source.sensor for name, source in found.enabled.items()}
        return Task(found.model, sensors, self._initial or found.initial_belief, found.filter)

    def candidate(self, values: Mapping[str, float]) -> Candidate:
        """Return the candidate of some values."""
        found = self._named.candidate(values)
        return found if self._initial is None else replace(found, initial=self._initial)


class _FunctionProblem:
    """A function from parameters to a model and sensors."""

    def __init__(
        self,
        function: Callable[..., Any],
        starts: Any,
        bounds: Mapping[str, tuple[float, float]],
        priors: Mapping[str, tuple[float, float]],
        linear: Sequence[str],
        initial: Any,
        filter: str,
    ) -> None:
        self._function, self._initial, self._filter = function, initial, filter.lower()
        known = _defaults(function)
        if isinstance(starts, Mapping):
            known.update({name: number(name, value) for name, value in starts.items()})
            names = list(starts)
        else:
            names = [starts] if isinstance(starts, str) else list(starts or known)
            refuse_unknown(names, known, 'parameter to fit')
        for what, given in (('bounds', bounds), ('priors', priors), ('linear', linear)):
            refuse_unknown(given, names, f'parameter in {what}')
        if not names:
            raise ValueError(
                "fit: expected the starts of the parameters, such as {'mass': 1.0}, got nothing"
            )
        self.parameters = [
            FreeParameter(
                name, known[name], *bounds.get(name, (-np.inf, np.inf)),
                positive=known[name] > 0.0 and name not in linear,
                scale=abs(known[name]) or 1.0, prior=priors.get(name),
            )
            for name in names
        ]  # fmt: skip

    def task(self) -> Task:
        """Return the model, sensors and belief at the start."""
        starts = {each.name: each.start for each in self.parameters}
        try:
            found = self._function(**starts)
        except TypeError as error:
            raise ValueError(f'problem: {error}') from None
        if not isinstance(found, tuple) or len(found) not in (2, 3):
            raise ValueError(
                f'problem: expected a function that returns a model and its sensors, and perhaps '
                f'the first belief, got {got(found)}'
            )
        model, sensors = found[0], sensors_of(found[1], found[0])
        first = found[2] if len(found) == 3 else self._initial
        belief = belief_of(first, model)
        plan = _plan(model, sensors)
        return Task(model, sensors, belief, self._filter or ('kf' if plan.linear else 'ekf'))

    def candidate(self, values: Mapping[str, float]) -> Candidate:
        """Return the candidate of some values."""
        model, given, *rest = self._function(**values)
        sensors = sensors_of(given, model)
        belief = belief_of(rest[0] if rest else self._initial, model)
        plan = _plan(model, sensors)
        kind = self._filter or ('kf' if plan.linear else 'ekf')
        return Candidate(build_filter(kind, plan), model, sensors, belief)


def _plan(model: Any, sensors: Mapping[str, Any]) -> Plan:
    return Plan(model, {name: TimedSensor(each, 1.0) for name, each in sensors.items()}, 1.0)


def _defaults(function: Callable[..., Any]) -> dict[str, float]:
    """Return the arguments of a function that have a number as their default."""
    import inspect

    found = {}
    for name, each in inspect.signature(function).parameters.items():
        if isinstance(each.default, (int, float)) and not isinstance(each.default, bool):
            found[name] = float(each.default)
    return found
