# SPDX-License-Identifier: Apache-2.0
"""Outcomes of a loop at the points of a grid of parameters."""

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
from kalman_ros.control.limiter import LIMITS
from kalman_ros.core import DesignError
from kalman_ros.estimators import filter_class
from kalman_ros.report.run_tables import plain
from kalman_ros.scenario import Scenario
from kalman_ros.scenario import regulator as regulators
from kalman_ros.simulation.batch_loop import Loop
from kalman_ros.simulation.faults.plant_faults import PlantFaults
from kalman_ros.simulation.loop_law import Law

from .ranges import Range


@dataclass(frozen=True)
class Point:
    """The outcome of the runs at a point.

    Parameters
    ----------
    values
        Values of the parameters.
    refused
        Reason why there is no loop at the point; empty if there is a loop.
    cost, cost_error
        Mean cost per second, and its standard error; NaN without an input.
    rms, claimed
        Root mean square error of each state, and the error that the estimator claims.
    anees, anees_bounds
        Average normalised error squared, and its bounds for a consistent filter.
    lost
        Share of the runs that are lost.
    limited
        Share of the steps in which a limit changed the input.
    theory_cost, theory_rms
        Cost and errors in steady state of a plant as believed; None without a theory.
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
        at = {swept.label: value for swept, value in zip(ranges, self.values)}
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
            'anees_bounds': [plain(bound) for bound in self.anees_bounds],
            'lost': self.lost,
            'limited': self.limited,
        }


@dataclass(frozen=True)
class Grid:
    """The loops of a sweep.

    Parameters
    ----------
    plant, believed
        Parameters of the plant, and of estimator and controller.
    ranges
        Swept parameters, one or two.
    seeds
        Seeds of the runs, the same at each point.
    seconds, after
        Duration of a run, and of its start that averages omit: by default the theoretical
        settling time.
    """

    plant: Mapping[str, Any]
    believed: Mapping[str, Any]
    ranges: Sequence[Range]
    seeds: tuple[int, ...]
    seconds: float
    after: float | None

    @property
    def points(self) -> list[tuple[float, ...]]:
        """Values at each point; the last range varies fastest."""
        return list(product(*(swept.values for swept in self.ranges)))

    def loop(self, values: tuple[float, ...]) -> tuple[Loop, dict[str, Any]]:
        """Return the loop at a point, without its law, and the controller's parameters.

        Raises
        ------
        ValueError
            If a parameter is unknown or wrong.
        """
        plant, believed = dict(self.plant), dict(self.believed)
        for swept, value in zip(self.ranges, values):
            if swept.plant and swept.name not in LIMITS:
                plant = swept.set_in(plant, value)
            if swept.believed or swept.name in LIMITS:
                believed = swept.set_in(believed, value)
        real = scenario.build(plant)
        faults = PlantFaults.from_values(real.timed, real.model.input.size, plant)
        return Loop(
            real, scenario.build(believed), self.seconds, faults=faults if faults.any else None
        ), believed

    def __call__(self, values: tuple[float, ...]) -> Point:
        """Return the outcome at a point."""
        loop, parameters = self.loop(values)
        believed = loop.believed
        try:
            law = _law(believed, parameters) if believed.model.input.size else None
        except DesignError as error:
            return Point(values, str(error))
        result = ensemble(replace(loop, answer=law), law, self.seeds, after=self.after)
        theory = (None, None) if loop.faults else self._theory(believed)
        return Point(
            values,
            '',
            result.cost,
            result.cost_error,
            tuple(result.rms.tolist()),
            tuple(result.std.tolist()),
            result.anees,
            result.anees_bounds,
            result.lost_share,
            float(result.outcomes.limited.mean()),
            *theory,
        )

    @property
    def as_believed(self) -> bool:
        """Whether the plant is as estimator and controller believe, at every point."""
        known = scenario.options(self.believed)
        same = all(self.plant.get(name) == self.believed.get(name) for name in known)
        return same and all(swept.plant == swept.believed for swept in self.ranges)

    def _theory(self, believed: Scenario) -> tuple[float | None, tuple[float, ...] | None]:
        if not self.as_believed or not believed.law or filter_class(believed.filter).mixture:
            return None, None
        try:
            theory = checks.theory(believed)
            variances = theory.loop.posterior.diagonal(axis1=1, axis2=2).mean(axis=0)
            return float(theory.expected_cost), tuple(np.sqrt(variances).tolist())
        except (ValueError, np.linalg.LinAlgError):
            return None, None


def _law(believed: Scenario, values: Mapping[str, Any]) -> Law:
    limits, idle = regulators.actuators(believed, values)
    return Law(believed, regulators.feedback(believed), limits, None, idle)
