# SPDX-License-Identifier: Apache-2.0
"""Evaluation of a run by the theory of its LQG loop, or by consistency if there is no theory."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan

import numpy as np
from scipy.special import ndtri

from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Trajectory

from . import checks as verdicts
from .checks import MISS, Check
from .nees_spread import average_nees

#: The theory of a loop is that of an input at each step; a smaller share of them is too few.
_LEAST_COVERED = 0.9
#: The smallest numbers of steps, and of readings of each sensor, to evaluate consistency.
_LEAST_STEPS, _LEAST_READINGS = 100, 20


@dataclass(frozen=True)
class Judgement:
    """The comparisons of a run with its expectations.

    Parameters
    ----------
    checks
        Checks of the run.
    settling_time
        Duration in seconds of the start of the run, which is excluded.
    basis
        Basis of the expectations, as a sentence.
    claim
        Conclusion if every check passes.
    """

    checks: list[Check]
    settling_time: float
    basis: str
    claim: str


def least_duration(scenario: Scenario) -> float:
    """Return the least duration of a run in seconds; raise DesignError as `judge` does."""
    if _has_theory(scenario):
        return verdicts.theory(scenario).least_duration
    slowest = min((source.timed.rate for source in scenario.enabled.values()), default=0.0)
    steps = _LEAST_STEPS / scenario.rate
    return max(steps, _LEAST_READINGS / slowest) if slowest else steps


def _has_theory(scenario: Scenario) -> bool:
    return scenario.plan.linear and bool(scenario.law)


def judge(scenario: Scenario, run: Trajectory) -> Judgement:
    """Compare a run with its expectations.

    Raises
    ------
    DesignError
        If the scenario has an LQG loop that cannot be stabilised.
    ValueError
        If the run is too short.
    """
    sparse = _has_theory(scenario) and _coverage(scenario, run) < _LEAST_COVERED
    if _has_theory(scenario) and not sparse:
        theory = verdicts.theory(scenario)
        results = verdicts.checks(scenario, theory, run)
        basis = "The theory of J is the LQG optimum tr(X Q) + tr(K'(Q_u + G'X G) K P)."
        if not verdicts.is_optimum(scenario):
            basis = 'The theory of J is that of these gains, which are not the optimum.'
        claim = 'The loop is stable and its statistics hold.'
        return Judgement(results, theory.settling_time, basis, claim)
    reason = 'The cost of this loop is not known' if scenario.law else 'There is no input'
    if sparse:
        reason = 'In real time an estimate follows a reading, and not each step, as in theory'
    basis = f'{reason}; the filter is judged by its consistency.'
    claim = 'The filter is consistent.'
    least = least_duration(scenario)
    if not len(run.time) or run.time[-1] - run.time[0] + 0.5 / scenario.rate < least:
        raise ValueError(f'run: expected {least:.4g} s or more to judge it')
    return Judgement(consistency(scenario, run), 0.0, basis, claim)


def _coverage(scenario: Scenario, run: Trajectory) -> float:
    """Return the share of the steps of a run that have an estimate."""
    if not len(run.time):
        return 1.0
    duration = float(run.time[-1] - run.time[0])
    return len(run.time) / (1.0 + round(duration * scenario.rate))


def consistency(scenario: Scenario, run: Trajectory) -> list[Check]:
    """Check whether the errors of a run match the covariance of the filter, start included.

    Innovations are white, so the sum of their NIS is chi-square. Errors are not white, so the test
    for each state is of its largest error in standard deviations: for any correlation, N errors
    all stay below the quantile of 1 - miss / N (Bonferroni). The scatter of the average NEES
    follows from the memory of the filter; see `nees_spread`.
    """
    space = scenario.model.state
    miss = MISS / (space.size + len(scenario.enabled) + 1)
    error = np.abs(space.subtract(run.truth, run.estimate))
    largest = (error / np.sqrt(run.covariance.diagonal(axis1=1, axis2=2))).max(axis=0)
    limit = float(-ndtri(miss / (2.0 * len(error))))
    results = [
        Check.within(f'largest error of {name} / std', '', nan, value, 0.0, limit)
        for name, value in zip(space.names, largest.tolist())
    ]
    results.append(nees_check(scenario, run, miss))
    for name in scenario.enabled:
        nis = run.innovations[name].nis
        k = scenario.sensors[name].sensor.output.size
        value = float(nis.mean()) / k if len(nis) else np.nan
        variance = 2.0 / (k * max(1, len(nis)))
        results.append(Check.ratio(f'NIS of {name} / {k}', value, variance, miss))
    return results


def nees_check(scenario: Scenario, run: Trajectory, miss: float = MISS) -> Check:
    """Check the average NEES after the start; the check fails if a covariance is singular.

    A consistent filter passes with the probability 1 - ``miss``.
    """
    n = scenario.model.state.size
    try:
        _, mean, variance = average_nees(scenario, run)
    except np.linalg.LinAlgError:
        mean, variance = inf, 2.0 / n
    return Check.ratio(f'NEES / {n}', mean, variance, miss)
