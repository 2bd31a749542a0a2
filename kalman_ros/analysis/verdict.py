# SPDX-License-Identifier: Apache-2.0
"""The evaluation of a run: by the theory of the LQG loop where it applies, else by consistency."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan

import numpy as np
from scipy.special import ndtri

from kalman_ros.estimators.consistency import chi_square_bounds
from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Trajectory

from . import checks as verdicts
from .checks import MISS, Check
from .nees_spread import average_nees

#: The least steps, and readings of each sensor, of a run for an evaluation of its consistency.
_LEAST_STEPS, _LEAST_READINGS = 100, 20


@dataclass(frozen=True)
class Judgement:
    """The comparisons of a run with its expectations.

    Parameters
    ----------
    checks
        The comparisons.
    settling_time
        The initial part of the run, in seconds, that is excluded.
    basis
        What the expectations are based on, in a sentence.
    claim
        The conclusion if every check passes.
    """

    checks: list[Check]
    settling_time: float
    basis: str
    claim: str


def least_duration(scenario: Scenario) -> float:
    """Return the least duration of a run in seconds; DesignError as `judge`."""
    if _has_theory(scenario):
        return verdicts.theory(scenario).least_duration
    slowest = min((source.timed.rate for source in scenario.enabled.values()), default=0.0)
    steps = _LEAST_STEPS / scenario.rate
    return max(steps, _LEAST_READINGS / slowest) if slowest else steps


def _has_theory(scenario: Scenario) -> bool:
    return scenario.plan.linear and bool(scenario.law)


def judge(scenario: Scenario, run: Trajectory) -> Judgement:
    """Return the judgement of a run.

    Raises
    ------
    DesignError
        If the scenario has an LQG loop that cannot be stabilised.
    ValueError
        If the run is too short.
    """
    if _has_theory(scenario):
        theory = verdicts.theory(scenario)
        found = verdicts.checks(scenario, theory, run)
        basis = "The theory of J is the LQG optimum tr(S Q) + tr(K'(R + G'S G) K P)."
        if scenario.law != 'lqr':
            basis = 'The theory of J is that of these gains, which are not the optimum.'
        claim = 'The loop is stable and its statistics hold.'
        return Judgement(found, theory.settling_time, basis, claim)
    what = 'This loop has no theory' if scenario.law else 'There is no input'
    basis = f'{what}; the filter is judged by its consistency.'
    claim = 'The filter is consistent.'
    least = least_duration(scenario)
    if not len(run.time) or run.time[-1] - run.time[0] + 0.5 / scenario.rate < least:
        raise ValueError(f'run: expected {least:.4g} s or more to judge it')
    return Judgement(consistency(scenario, run), 0.0, basis, claim)


def consistency(scenario: Scenario, run: Trajectory) -> list[Check]:
    """Return whether the errors of a run match the filter's covariance, start included.

    Innovations are white, so the average of their NIS is chi-square. Errors are not, so for each
    state the largest one is tested, in standard deviations: with any correlation, N of them
    all stay below the quantile of 1 - miss / N (Bonferroni). How much the average NEES scatters
    follows from how fast the filter forgets; see `nees_spread`.
    """
    space = scenario.model.state
    miss = MISS / (space.size + len(scenario.enabled) + 1)
    error = np.abs(space.subtract(run.truth, run.estimate))
    worst = (error / np.sqrt(run.covariance.diagonal(axis1=1, axis2=2))).max(axis=0)
    most = float(-ndtri(miss / (2.0 * len(error))))
    found = [
        Check(f'largest error of {name} / std', '', nan, value, 0.0, most, value <= most)
        for name, value in zip(space.names, worst.tolist())
    ]
    found.append(nees_check(scenario, run, miss))
    for name in scenario.enabled:
        nis = run.innovations[name].nis
        k = scenario.sensors[name].sensor.output.size
        low, high = chi_square_bounds(1.0, 2.0 / (k * max(1, len(nis))), miss)
        value = float(nis.mean()) / k if len(nis) else np.nan
        label = f'NIS of {name} / {k}'
        found.append(Check(label, '', 1.0, value, low, high, low <= value <= high))
    return found


def nees_check(scenario: Scenario, run: Trajectory, miss: float = MISS) -> Check:
    """Return the check of the average NEES after the start; it fails without a covariance.

    A consistent filter passes with the probability 1 - ``miss``.
    """
    n = scenario.model.state.size
    try:
        _, mean, variance = average_nees(scenario, run)
    except np.linalg.LinAlgError:
        mean, variance = inf, 2.0 / n
    low, high = chi_square_bounds(1.0, variance, miss)
    return Check(f'NEES / {n}', '', 1.0, mean, low, high, low <= mean <= high)
