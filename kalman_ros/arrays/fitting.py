# SPDX-License-Identifier: Apache-2.0
"""Parameters from arrays of readings, by maximum likelihood."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Union

import numpy as np

from kalman_ros.analysis.tuning.fit import Fit, Fitted
from kalman_ros.analysis.tuning.fit import fit as fit_likelihood
from kalman_ros.analysis.tuning.held_out import Judgement, judge
from kalman_ros.analysis.tuning.likelihood import Likelihood
from kalman_ros.analysis.tuning.observations import Observations, Readings
from kalman_ros.analysis.tuning.walk import Conditions
from kalman_ros.compiled.parts import NUMPY, parts
from kalman_ros.core import Array, ArrayLike
from kalman_ros.core.known_arguments import knows_arguments
from kalman_ros.core.known_names import KnownNames
from kalman_ros.estimators.diffuse import check_start
from kalman_ros.estimators.policy import Policy

from . import text
from .accept import number
from .filtering import _inputs
from .passing import gate_limits
from .rows import Rows, readings_of
from .tuned_problems import FunctionProblem, ScenarioProblem

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
    stopped
        Why it was not; '' if it was.
    held_out
        What the filter makes of the readings that were held out, before and after the fit; None
        if there are none.
    count
        The number of readings that were fused.
    arithmetic
        What computed the model and the sensors, with the reason where it is not C.
    changes
        Parameters of a scenario with the fitted values, as `load` takes them, without biases;
        for a function, its arguments.
    """

    parameters: Mapping[str, Fitted]
    correlation: Array
    log_likelihood: tuple[float, float]
    aic: tuple[float, float]
    converged: bool
    stopped: str
    held_out: tuple[Judgement, Judgement] | None
    count: int
    arithmetic: str = NUMPY
    changes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, float]:
        """The fitted values; of those that are not determined, one choice of many."""
        return {name: parameter.value for name, parameter in self.parameters.items()}

    @property
    def undetermined(self) -> dict[str, str]:
        """Why, by the name of each parameter that the data do not determine."""
        return {
            name: parameter.reason
            for name, parameter in self.parameters.items()
            if parameter.reason
        }

    def __repr__(self) -> str:
        p = len(self.parameters)
        lines = [f'{p} parameter{"" if p == 1 else "s"} fitted to {self.count} readings']
        rows = []
        for name, parameter in self.parameters.items():
            label = f'{name} [{parameter.unit}]' if parameter.unit else name
            value = f'{parameter.value:.4g}' if parameter.interval else ''
            rows.append(
                [label, f'{parameter.start:.4g}', value, parameter.interval or 'not determined']
            )
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
            lines += text.sentence(f'not converged, {self.stopped}: what was reached so far')
        if '(' in self.arithmetic:  # there is a reason, and it costs time
            lines += text.sentence(f'computed by {self.arithmetic}')
        if self.held_out is not None:
            before, after = self.held_out
            gain = after.log_likelihood - before.log_likelihood
            verdict = 'consistent' if after.consistent else 'not consistent'
            if after.consistent and not after.judged:
                verdict = 'too few to judge'
            lines.append(f'readings held out: log-likelihood {gain:+.4g}, {verdict}')
        return '\n'.join(lines)


@knows_arguments(
    parameters='fit', params='fit', p0='fit', x0='initial', t='times', y='readings', u='inputs'
)
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
    biases: Sequence[str] = (),
    delays: Sequence[str] = (),
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
    biases, delays
        The sensors whose biases (what their readings are too large by) and delays (by how many
        seconds their times are too late) are fitted, too.
    filter
        ``'kf'``, ``'ekf'`` or ``'ukf'``; by default the scenario's, or the simplest that serves.
    hold_out
        The share of the readings, the last ones, that are kept to judge the fit.

    Raises
    ------
    ValueError
        If an argument is invalid, or there is no likelihood; the message names it.

    Examples
    --------
    >>> import numpy as np
    >>> import kalman_ros as kr
    >>> def level(q=1.0):
    ...     return kr.discrete_model(1.0, Q=q), ([[1.0]], 0.25), (0.0, 1.0)
    >>> rng = np.random.default_rng(0)
    >>> y = np.cumsum(0.3 * rng.normal(size=400)) + 0.5 * rng.normal(size=400)
    >>> round(kr.tune(level, np.arange(400.0), y).values['q'], 3)
    0.09
    """
    share = number('hold_out', hold_out)
    if not 0.0 <= share < 1.0:
        raise ValueError(f'hold_out: expected a share from 0 to below 1, got {share:g}')
    if callable(problem):
        function = FunctionProblem(
            problem, fit, bounds or {}, priors or {}, linear, initial, filter
        )
        function.add_errors(biases, delays)
        made: FunctionProblem | ScenarioProblem = function
    else:
        also = [*(f'{name}.bias' for name in biases), *(f'{name}.delay' for name in delays)]
        made = ScenarioProblem(problem, fit, also, bounds or {}, priors or {}, initial, filter)
    task = made.task()
    rows = readings_of(times, readings, task.sensors, task.model)
    if not any(np.isfinite(series.values).any() for series in rows.values()):
        raise ValueError('readings: expected at least one finite number, got none')
    acts = _inputs(task.model, inputs, input_times, times, rows)
    observations = _observations(rows, acts)
    first = made.candidate({parameter.name: parameter.start for parameter in made.parameters})
    check_start(first.filter, first.initial, first.sensors, 'initial')
    limits = gate_limits(gates, task.sensors, {name: name for name in task.sensors})
    policy = Policy(window=0.0, max_gap=0.0, restart_after=0, gates=limits)
    until = observations.until(1.0 - share) if share else None
    likelihood = Likelihood(
        made.parameters, made.candidate, observations,
        Conditions(policy, np.zeros(task.model.input.size)), until,
    )  # fmt: skip
    tuned = tuning(likelihood, parts(task.model, task.sensors).arithmetic)
    return replace(tuned, changes=made.changes(tuned.values))


def tuning(likelihood: Likelihood, arithmetic: str = NUMPY) -> Tuning:
    """Return the fit of a likelihood, judged on the readings after its end."""
    optimum: Fit = fit_likelihood(likelihood)
    if optimum.interrupted:
        raise KeyboardInterrupt
    held = None
    if likelihood.until is not None and optimum.complete:
        starts = {parameter.name: parameter.start for parameter in likelihood.parameters}
        held = (
            judge(likelihood, starts, likelihood.until)[0],
            judge(likelihood, optimum.values, likelihood.until)[0],
        )
    return Tuning(
        {parameter.name: parameter for parameter in optimum.parameters}, optimum.correlation,
        (optimum.before, optimum.after), optimum.aic, optimum.converged, optimum.stopped,
        held, optimum.count, arithmetic,
    )  # fmt: skip


def _observations(rows: Mapping[str, Rows], acts: Rows) -> Observations:
    readings = {
        name: Readings(np.asarray(series.stamps, dtype=np.int64), series.values)
        for name, series in rows.items()
    }
    return Observations(readings, np.asarray(acts.stamps, dtype=np.int64), acts.values)


# the same by the name that others have for it
fit = tune
