# SPDX-License-Identifier: Apache-2.0
"""The theory of a scenario, for a notebook."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros import scenario as scenarios
from kalman_ros.analysis import design_warnings
from kalman_ros.analysis.design_report import ClosedLoop, DesignReport
from kalman_ros.analysis.design_theory import report
from kalman_ros.control.stability import Mode
from kalman_ros.core import Array, Dynamics
from kalman_ros.core.known_arguments import knows_arguments
from kalman_ros.core.known_names import KnownNames
from kalman_ros.linear.structure import ComplexArray
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import actuators

from .accept import columns, number, rows, square
from .estimates import _path
from .foreign import is_foreign, read_system
from .gain_results import InputMargins
from .scenarios import BELIEVED, make_scenario, values_of
from .text import WIDTH


@dataclass(frozen=True, repr=False)
class Design(KnownNames):
    """A design that prints as ``./dev design`` does; its numbers are in ``report``.

    Parameters
    ----------
    report
        All numbers.
    delay
        Seconds between a reading and the resulting input.
    parameters
        Parameters of the scenario; None if it was built of objects.
    """

    report: DesignReport
    delay: float
    parameters: Mapping[str, Any] | None = None

    @property
    def warnings(self) -> list[str]:
        """What may go wrong, one sentence each."""
        return list(
            design_warnings.warnings(self.report, self.delay or 1.0 / self.report.scenario.rate)
        )

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The modes of the model, each with its pole and time constant."""
        return self.report.modes

    @property
    def poles(self) -> ComplexArray:
        """The poles of the model (n,), with both of each pair."""
        poles = [pole for mode in self.modes for pole in {mode.pole, mode.pole.conjugate()}]
        return np.array(poles, dtype=complex)

    @property
    def K(self) -> Array:  # noqa: N802
        """The gain (m, n) of the regulator."""
        if self.report.regulator is None:
            raise ValueError('K: there is no input to regulate')
        return self.report.regulator.feedback.gain

    @property
    def L(self) -> Mapping[str, Array]:  # noqa: N802
        """The gain (n, k) of the estimator for each sensor."""
        if self.report.estimator is None:
            raise ValueError('L: the estimator has no steady state')
        return self.report.estimator.gains

    @property
    def margins(self) -> dict[str, InputMargins]:
        """The margins at each input, with the estimator where it has a steady state."""
        margins = {}
        for loops in self.report.regulator.loops if self.report.regulator else ():
            loop = loops.estimated or loops.known
            at = loop.margins or loop.prompt
            margins[loops.input] = InputMargins(**vars(at), loop=loop.broken)
        return margins

    @property
    def cost(self) -> float:
        """The mean cost a second of the closed loop."""
        return self._closed_loop('cost').cost

    @property
    def settling_time(self) -> float:
        """Seconds in which the closed loop settles to a thousandth."""
        return self._closed_loop('settling_time').settling_time

    def _closed_loop(self, name: str) -> ClosedLoop:
        if self.report.closed_loop is None:
            raise ValueError(f'{name}: there is no loop of a regulator and a settled estimator')
        return self.report.closed_loop

    @property
    def std(self) -> Array:
        """The standard deviations (n,) of the estimate, once it has settled."""
        if self.report.estimator is None:
            raise ValueError('std: the estimator has no steady state')
        return self.report.estimator.std

    def __repr__(self) -> str:
        from rich.console import Console  # for people only

        from kalman_ros.report import design_tables, sheet

        out = StringIO()
        console = Console(file=out, width=WIDTH, highlight=False, force_terminal=False)
        console.print(design_tables.structure(self.report), markup=False)
        sheet.show(console, design_tables.tables(self.report))
        console.print()
        for sentence in (*design_tables.closing(self.report), *design_warnings.notes(self.report)):
            console.print(sentence, markup=False)
        for sentence in self.warnings:
            console.print(f'Warning: {sentence}', markup=False)
        return '\n'.join(line.rstrip() for line in out.getvalue().splitlines())

    def plot(self, path: str | Path | None = None, what: str = 'loops') -> None:
        """Draw the ``'loops'`` (Bode and Nyquist), the ``'poles'`` or the ``'uncertainty'``.

        With a ``path`` the picture is saved there; else a notebook or ``plt.show()`` shows it.
        """
        from kalman_ros.core import refuse_unknown
        from kalman_ros.report import design_pictures

        drawings = {
            'loops': design_pictures.loops,
            'poles': design_pictures.poles,
            'uncertainty': design_pictures.uncertainty,
        }
        refuse_unknown([what], drawings, 'picture')
        if what == 'loops' and self.report.regulator is None:
            raise ValueError('plot: there is no loop without an input; draw poles or uncertainty')
        drawings[what](self.report, _path(path))


@knows_arguments()
def design(
    scenario: Any = 'mass_spring_damper_2d',
    overrides: Mapping[str, Any] | None = None,
    *,
    delay: float = 0.0,
) -> Design:
    """Return the theory of a loop: modes, gains, errors, the LQG optimum, margins, warnings.

    Parameters
    ----------
    scenario, overrides
        As for `load`, with the parameters of estimator and controller. Or a system of
        python-control or scipy.signal alone, with noise of density 1 at each of its inputs,
        or a pair (system, W); readings of variance 1 of each of its outputs, and costs of 1; in
        continuous time at 20 samples per radian of its fastest mode.
    delay
        Seconds between a reading and the resulting input.

    Raises
    ------
    ValueError
        If the scenario is wrong, or no sensor is on.
    DesignError
        If the input cannot stabilise the model, or no sensor observes a growing mode.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> kr.design('cart_pole').K.round(1)
    array([[-62. , -33.5,  95.1,  18.8]])
    """
    parameters = None
    alone = scenario[0] if isinstance(scenario, tuple) and len(scenario) == 2 else scenario
    if overrides is None and is_foreign(alone) and not isinstance(alone, Dynamics):
        scenario = _normalised(scenario)
    if not isinstance(scenario, Scenario):
        parameters = values_of(scenario, {} if overrides is None else overrides, *BELIEVED)
        scenario = scenarios.build(parameters)
    delay = number('delay', delay, 'a number of seconds')
    values = parameters or {}
    bounds = None
    if scenario.model.input.size:
        bounds, _ = actuators(scenario, values)
    return Design(report(scenario, delay, limits=bounds), delay, parameters)


def _normalised(given: Any) -> Scenario:
    """Return the loop of a system with noise and costs of 1."""
    alone, noise = given if isinstance(given, tuple) else (given, None)
    system: Any = read_system('scenario', alone)
    A = square('scenario: A', system.A)
    B = columns('scenario: B', system.B, len(A))
    C = rows('scenario: C', system.C, len(A))
    if np.any(system.D):
        raise ValueError('scenario: expected readings of the state alone, got a D that is not 0')
    rate = None
    if system.dt is None:
        rate = 20.0 * max(np.abs(np.linalg.eigvals(A)).max(initial=0.0), 0.05)
    return make_scenario((alone, B @ B.T if noise is None else noise), (C, 1.0), rate=rate)
