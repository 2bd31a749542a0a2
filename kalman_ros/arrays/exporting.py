# SPDX-License-Identifier: Apache-2.0
"""A designed loop as C, from a notebook."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

from kalman_ros import scenario as scenarios
from kalman_ros.control.feedback import TRANSITION_TIME
from kalman_ros.control.motion import Motion
from kalman_ros.core import ArrayLike
from kalman_ros.core.known_arguments import knows_arguments
from kalman_ros.core.known_names import KnownNames
from kalman_ros.embedded.loop import loop
from kalman_ros.embedded.writing import Built, Written, build, write
from kalman_ros.estimators.policy import Policy
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import actuators

from . import text
from .accept import limits_given, number, whole
from .scenarios import BELIEVED, values_of


@dataclass(frozen=True, repr=False)
class Export(KnownNames):
    """A loop that was written as C.

    Parameters
    ----------
    written
        The folder, its files and the name.
    built
        Sizes, time and the largest difference from Python; None if it was not built.
    """

    written: Written
    built: Built | None

    def __repr__(self) -> str:
        written = self.written
        lines = text.sentence(f'{written.name} in {written.folder}: {", ".join(written.files)}')
        if self.built is None:
            return '\n'.join([*lines, 'not built'])
        return '\n'.join([*lines, *text.table(['', self.built.command], self.built.rows)])


@knows_arguments(folder='out', dir='out', path='out', float32="precision: 'float32'")
def export(
    scenario: Scenario | str | Path | Mapping[str, Any],
    out: str | Path,
    overrides: Mapping[str, Any] | None = None,
    *,
    name: str = '',
    precision: str = 'float64',
    control: bool = True,
    input_limit: ArrayLike | None = None,
    input_lower_limit: ArrayLike | None = None,
    input_rate_limit: ArrayLike | None = None,
    idle_input: str | None = None,
    recover_after: int | None = None,
    max_gap: float | None = None,
    transition_time: float | None = None,
    motion: Motion | None = None,
    compile: bool = True,
) -> Export:
    """Write the estimator and the law of a loop as C99, and check it against Python.

    Parameters
    ----------
    scenario, overrides
        As for `load`, with the parameters of estimator and controller; `make_scenario` makes one
        of a model, sensors, a filter and a law.
    out
        A folder that is not there yet.
    name
        The beginning of every public name in C; by default that of the file, or ``loop``.
    precision
        ``'float64'`` or ``'float32'``.
    control
        Whether the law is exported, if there is an input.
    input_limit, input_lower_limit, input_rate_limit
        Of the input; by default those of the file, or none.
    idle_input
        The input while no controller acts, ``'zero'`` or ``'equilibrium'``.
    recover_after
        Rejections in a row after which the covariance is widened; 0: never.
    max_gap
        Seconds without a prediction after which the estimate restarts; 0: never.
    transition_time
        Seconds in which the jump of the input after an idle time decays; 0: at once.
    motion
        What the law can follow: a `kr.motion` of this scenario, with its gains, as a table.
    compile
        Whether to build and check it, if there is a C compiler.

    Raises
    ------
    ValueError
        If something cannot be exported; the message says what, and why.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kr.export('mass_spring_damper', 'spring_c', compile=False)
    mass_spring_damper in spring_c: mass_spring_damper.h, mass_spring_damper.c,
      check.c, Makefile, vectors.txt
    not built
    """
    values: Mapping[str, Any] = {}
    if not isinstance(scenario, Scenario):
        values = values_of(scenario, {} if overrides is None else overrides, *BELIEVED)
        named = scenario if isinstance(scenario, (str, Path)) else ''
        name = name or Path(named).stem
        scenario = scenarios.build(values)
    elif overrides:
        raise ValueError('overrides: expected none for a Scenario, whose objects are built')
    choices = {
        'idle_input': (idle_input, 'zero'),
        'gate_recover_after': (recover_after, Policy.recover_after),
        'max_gap': (max_gap, Policy.max_gap),
        'transition_time': (transition_time, TRANSITION_TIME),
    }
    idle, rejections, gap, transition = (  # as in the file
        values.get(key, default) if given is None else given
        for key, (given, default) in choices.items()
    )
    policy = Policy(
        recover_after=whole('recover_after', rejections, 0),
        max_gap=number('max_gap', gap, 'a number of seconds'),
    )
    blend = number('transition_time', transition, 'a number of seconds')
    own_limits = limits_given(input_limit, input_lower_limit, input_rate_limit)
    bounds, at_rest = actuators(scenario, {**values, **own_limits, 'idle_input': idle})
    if not 0.0 <= blend < inf:
        raise ValueError(f'transition_time: expected at least 0 s, got {blend:g}')
    exported = loop(scenario, policy, bounds, at_rest, control=control, motion=motion, blend=blend)
    source = f'{name}.yaml' if values and name else 'a scenario of Python'
    written = write(exported, Path(out), name or 'loop', precision, source)
    return Export(written, build(written) if compile else None)
