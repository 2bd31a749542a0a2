# SPDX-License-Identifier: Apache-2.0
"""What becomes of a loop at each point of a grid of parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import inf, isnan, nan
from typing import Any

import numpy as np

from kalman_ros import scenario
from kalman_ros.analysis import checks
from kalman_ros.analysis.ensemble import ensemble
from kalman_ros.core import DesignError
from kalman_ros.estimators import filter_class
from kalman_ros.report.run_tables import plain
from kalman_ros.scenario import Scenario
from kalman_ros.scenario import regulator as regulators
from kalman_ros.simulation.batch_loop import Loop
from kalman_ros.simulation.faults.plant_faults import PlantFaults
from kalman_ros.simulation.loop_law import Law

from .ranges import LIMITS, Range


@dataclass(frozen=True)
class Point:
    """The outcome of the runs at a point.

    Parameters
    ----------
    values
        Of the parameters.
    refused
        Why there is no loop there; empty if there is one.
    cost, cost_error
        The mean cost per second, and its standard error; NaN without an input.
    rms, claimed
        The root mean square error of each state, and what the estimator claimed.
    anees, anees_bounds
        The average normalised error squared, and where that of a consistent filter is.
    lost
        The share of the runs that are lost.
    limited
        The share of the steps in which a limit changed the input.
    theory_cost, theory_rms
        Of a loop whose plant is as believed, in steady state; None without a theory.
    """

    values: tuple[float, ...]
    refused: str = ''
    cost: float = nan
    cost_error: float = nan
    rms: tuple[float, ...] = ()
    claimed: tuple[float, ...] = ()
    anees: float = nan
    anees_bounds: tuple[float, float] = (0.0, inf)
    lost: float = nan
    limited: float = 0.0
    theory_cost: float | None = None
    theory_rms: tuple[float, ...] | None = None

    @property
    def consistent(self) -> bool:
        """Whether the ANEES, if there is one, is within its bounds."""
        return isnan(self.anees) or self.anees_bounds[0] <= self.anees <= self.anees_bounds[1]

    def json(self, ranges: Sequence[Range], states: Sequence[str]) -> dict[str, Any]:
        """Return the point for ``summary.json``."""
        at = {each.label: value for each, value in zip(ranges, self.values)}
        if self.refused:
            return {'at': at, 'refused': self.refused}
        return {
            'at': at,
            'cost': plain(self.cost),
            'cost_error': plain(self.cost_error),
            'theory_cost': self.theory_cost,
            'rms': dict(zip(states, map(plain, self.rms))),
            'claimed': dict(zip(states, map(plain, self.claimed))),
            'theory_rms': self.theory_rms and dict(zip(states, self.theory_rms)),
            'anees': plain(self.anees),
            'anees_bounds': [plain(each) for each in self.anees_bounds],
            'lost': self.lost,
            'limited': self.limited,
        }


@dataclass(frozen=True)
class Grid:
    """The loops of a sweep.

    Parameters
    ----------
    plant, believed
        The parameters of the plant, and of estimator and controller.
    ranges
        What is swept, one or two.
    seeds
        Of the runs at each point, the same at all.
    seconds, after
        Of each run, and of its start that averages omit; by default the settling time in theory.
    """

    plant: Mapping[str, Any]
    believed: Mapping[str, Any]
    ranges: Sequence[Range]
    seeds: tuple[int, ...]
    seconds: float
    after: float | None

    @property
    def points(self) -> list[tuple[float, ...]]:
        """The values at each point; the last range varies fastest."""
        return list(product(*(each.values for each in self.ranges)))

    def loop(self, values: tuple[float, ...]) -> tuple[Loop, dict[str, Any]]:
        """Return the loop at a point, without its law, and the controller's parameters.

        Raises
        ------
        ValueError
            If a parameter is unknown or wrong.
        """
        plant, believed = dict(self.plant), dict(self.believed)
        for each, value in zip(self.ranges, values):
            if each.plant and each.name not in LIMITS:
                plant = each.set_in(plant, value)
            if each.believed or each.name in LIMITS:
                believed = each.set_in(believed, value)
        real = scenario.build(plant)
        faults = PlantFaults.from_values(real.timed, real.model.input.size, plant)
        return Loop(
            real, scenario.build(believed), self.seconds, faults=faults if faults.any else None
        ), believed

    def __call__(self, values: tuple[float, ...]) -> Point:
        """Return the outcome at a point."""
        loop, own = self.loop(values)
        believed = loop.believed
        try:
            law = _law(believed, own) if believed.model.input.size else None
        except DesignError as error:
            return Point(values, str(error))
        found = ensemble(replace(loop, answer=law), law, self.seeds, after=self.after)
        theory = (None, None) if loop.faults else self._theory(believed)
        return Point(
            values,
            '',
            found.cost,
            found.cost_error,
            tuple(found.rms.tolist()),
            tuple(found.std.tolist()),
            found.anees,
            found.anees_bounds,
            found.lost_share,
            float(found.outcomes.limited.mean()),
            *theory,
        )

    @property
    def as_believed(self) -> bool:
        """Whether the plant is the one that the estimator believes in, at every point."""
        known = scenario.options(self.believed)
        same = all(self.plant.get(name) == self.believed.get(name) for name in known)
        return same and all(each.plant == each.believed for each in self.ranges)

    def _theory(self, believed: Scenario) -> tuple[float | None, tuple[float, ...] | None]:
        if not self.as_believed or not believed.law or not filter_class(believed.filter).optimal:
            return None, None
        try:
            found = checks.theory(believed)
            variances = found.loop.posterior.diagonal(axis1=1, axis2=2).mean(axis=0)
            return float(found.expected_cost), tuple(np.sqrt(variances).tolist())
        except (ValueError, np.linalg.LinAlgError):
            return None, None


def _law(believed: Scenario, values: Mapping[str, Any]) -> Law:
    limits = [np.ravel(values.get(name, inf)) for name in LIMITS]
    return Law(believed, regulators.feedback(believed), regulators.limits(believed, *limits), None)
