# SPDX-License-Identifier: Apache-2.0
"""The worst of a loop whose plant is not the one that its design believes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from io import StringIO
from math import inf
from pathlib import Path
from typing import Any, NamedTuple, Union

import numpy as np

from kalman_ros import scenario as scenarios
from kalman_ros.analysis.worst_case import Plant, WorstCases, named_plants, worst_cases
from kalman_ros.control.margins import Margins
from kalman_ros.control.worst_case import Bracket
from kalman_ros.core import Array, Dynamics, refuse_unknown
from kalman_ros.core.known_arguments import knows_arguments
from kalman_ros.core.known_names import KnownNames
from kalman_ros.scenario import Scenario

from . import text
from .accept import got, number
from .designing import Design
from .fitting import Tuning
from .scenarios import BELIEVED, values_of
from .tuned_problems import defaults

#: Low and high ends by name, or a fit with its intervals.
Intervals = Union[Mapping[str, tuple[float, float]], Tuning]


class Worst(NamedTuple):
    """The worst value over the intervals: the one found, its bound, and where it was found.

    No plant within the intervals is worse than the bound.
    """

    found: float
    bound: float
    point: dict[str, float]


@dataclass(frozen=True, eq=False, repr=False)
class WorstCase(KnownNames):
    """The worst of a loop over intervals of the plant's parameters; it prints itself.

    Parameters
    ----------
    intervals
        Value that the design believes, low and high end, by name.
    nominal_cost
        Mean cost a second with the plant as believed.
    cost
        The largest mean cost a second; infinite where a loop is unstable.
    disk
        The smallest disk margin, by input; 0 where a loop is unstable.
    margins
        All margins at that plant, by input; None if it is unstable there.
    stable_times
        Factors by which all intervals can be widened about the believed values: with the first
        every loop is stable, with the second one is not.
    unstable
        The parameters of that unstable loop; None if none was found.
    report
        All of it as arrays.
    """

    intervals: dict[str, tuple[float, float, float]]
    nominal_cost: float
    cost: Worst
    disk: dict[str, Worst]
    margins: Mapping[str, Margins | None]
    stable_times: tuple[float, float]
    unstable: dict[str, float] | None
    report: WorstCases

    @property
    def stable(self) -> bool:
        """Whether all loops within the intervals are proved to be stable."""
        return self.cost.found < inf and (self.stable_times[0] >= 1.0 or self.cost.bound < inf)

    @property
    def structured_singular_value(self) -> tuple[float, float]:
        """Lower and upper bound of its peak for these parameters; below 1 all loops are stable."""
        proved, refuted = self.stable_times
        return 1.0 / refuted, 1.0 / proved if proved else inf

    def __repr__(self) -> str:
        from rich.console import Console  # for people only

        from kalman_ros.report import sheet, worst_case_table

        out = StringIO()
        console = Console(file=out, width=text.WIDTH, highlight=False, force_terminal=False)
        console.print(f'Worst case over {worst_case_table.over(self.report)}', markup=False)
        sheet.show(console, [('', worst_case_table.table(self.report))])
        for sentence in worst_case_table.sentences(self.report):
            console.print(sentence, markup=False)
        return '\n'.join(line.rstrip() for line in out.getvalue().splitlines() if line.strip())


@knows_arguments(uncertainty='intervals', ranges='intervals', bounds='intervals')
def worst_case(
    design: Design | Scenario | str | Path | Mapping[str, Any],
    intervals: Intervals,
    overrides: Mapping[str, Any] | None = None,
    *,
    plant: Callable[..., Dynamics] | None = None,
) -> WorstCase:
    """Return the worst cost and margins of a loop over intervals of its plant's parameters.

    Law and estimator are those of the design and do not change. The worst values are searched, and
    bounded by storage functions that hold for whole boxes of parameters. The bounds assume that
    the plant is smooth in its parameters: a jump, or a narrow feature, can be missed.

    Parameters
    ----------
    design, overrides
        Result of `design`, or a scenario as for `load`.
    intervals
        Low and high ends by name, such as ``{'pole_mass': (0.1, 0.3)}``; ``actuator_gain`` is a
        factor of all inputs. Or the result of `tune`, whose 95 % intervals are taken.
    plant
        For a scenario of objects: the function of the parameters by name that returns the model;
        its defaults are the believed values.

    Raises
    ------
    ValueError
        If a name is unknown or an interval is invalid; there are one to three parameters.
    DesignError
        If there is no design.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> worst = kr.worst_case('mass_spring_damper_2d', {'mass': (0.8, 1.25)})
    >>> worst.stable
    True
    """
    ends = _ends(intervals)
    values: Mapping[str, Any] | None
    if isinstance(design, Design):
        built, values = design.report.scenario, design.parameters
    elif isinstance(design, Scenario):
        built, values = design, None
    else:
        values = values_of(design, {} if overrides is None else overrides, *BELIEVED)
        built = scenarios.build(values)
    if plant is not None:
        plants, box = _plants_of(plant, built, ends)
    elif values is None:
        raise ValueError('plant: expected a function of the parameters, for a scenario of objects')
    else:
        plants, box = named_plants(values, ends)
    return _result(worst_cases(built, plants, box), box)


def _ends(intervals: Intervals) -> dict[str, tuple[float, float]]:
    if isinstance(intervals, Tuning):
        known = {name: fit for name, fit in intervals.parameters.items() if fit.determined}
        return {name: (fit.low, fit.high) for name, fit in known.items()}
    if not isinstance(intervals, Mapping):
        raise ValueError(
            f"intervals: expected ends by name, such as {{'mass': (0.8, 1.2)}}, "
            f'got {got(intervals)}'
        )
    ends = {}
    for name, pair in intervals.items():
        if isinstance(pair, str) or np.size(pair) != 2:
            raise ValueError(f'{name}: expected a low and a high end, got {got(pair)}')
        low, high = (number(name, end) for end in pair)
        if not np.isfinite((low, high)).all():
            raise ValueError(f'{name}: expected finite ends, got {low:g} and {high:g}')
        ends[str(name)] = (low, high)
    return ends


def _plants_of(
    function: Callable[..., Dynamics], scenario: Scenario, ends: Mapping[str, tuple[float, float]]
) -> tuple[Callable[[Array], Plant], dict[str, tuple[float, float, float]]]:
    """Return the plants of a function, and the box of its parameters."""
    believed, box = defaults(function), {}
    refuse_unknown(ends, believed, 'parameter')
    for name, (low, high) in ends.items():
        box[name] = (believed[name], low, high)

    def plants(at: Array) -> Plant:
        values = dict(zip(box, at.tolist()))
        try:
            model = function(**values)
        except ArithmeticError as error:
            raise ValueError(f'plant: expected a model at {values}, got {error}') from None
        if not isinstance(model, Dynamics) or model.state.size != scenario.model.state.size:
            raise ValueError(f'plant: expected a model as in the scenario, got {got(model)}')
        return Plant(replace(scenario, model=model))

    return plants, box


def _result(worst: WorstCases, box: dict[str, tuple[float, float, float]]) -> WorstCase:
    short = [name.rpartition('.')[2] for name in worst.names]

    def at(point: Array) -> dict[str, float]:
        return dict(zip(short, point.tolist()))

    def disk(peak: Bracket) -> Worst:
        reached, bound = (2.0 / max(value, 1.0) for value in (peak.reached, peak.bound))
        return Worst(reached, bound, at(peak.point))

    limit = worst.stability
    return WorstCase(
        box, worst.nominal_cost,
        Worst(worst.cost.reached, worst.cost.bound, at(worst.cost.point)),
        {name: disk(peak) for name, peak in worst.disk.items()}, worst.margins,
        (limit.proved, limit.refuted), None if limit.point is None else at(limit.point), worst,
    )  # fmt: skip
