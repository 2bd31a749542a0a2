# SPDX-License-Identifier: Apache-2.0
"""A closed loop in this process: plant, estimator and the controller node's regulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros.core import Array, ArrayLike, refuse_unknown
from kalman_ros.core.known_arguments import knows_arguments
from kalman_ros.core.known_names import KnownNames
from kalman_ros.scenario import Scenario
from kalman_ros.simulation import closed_loop
from kalman_ros.simulation.batch_loop import Loop
from kalman_ros.simulation.faults.plant_faults import PlantFaults
from kalman_ros.simulation.loop_law import Reference
from kalman_ros.simulation.trajectory import Trajectory

from . import text
from .accept import duration, limits_given, whole
from .estimates import _path
from .loop_setup import Given, loop_of
from .tables import to_dataframe

#: The pictures of a run.
PICTURES = ('overview', 'states', 'errors', 'gains', 'innovations', 'force')


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
    _faults: PlantFaults | None = None

    @property
    def rms_error(self) -> Array:
        """The root of the mean square of the error of each state (n,)."""
        error = self.scenario.model.state.subtract(self.truth, self.estimate)
        return np.asarray(np.sqrt(np.mean(error**2, axis=0)))

    @property
    def claimed(self) -> Array:
        """The deviation of each state that the filter claims, as a root of the mean (n,)."""
        return np.asarray(np.sqrt(self.covariance.diagonal(axis1=1, axis2=2).mean(axis=0)))

    def __repr__(self) -> str:
        scenario, steps = self.scenario, len(self.time)
        state, input = scenario.model.state, scenario.model.input
        rms, claimed = self.rms_error.tolist(), self.claimed.tolist()
        law = f', law {scenario.law}' if scenario.law else ''
        lines = [
            f'{type(scenario.model).__name__} for {self.time[-1]:g} s at {scenario.rate:g} Hz, '
            f'filter {scenario.filter}{law}'
        ]
        if self._faults is not None:
            lines += text.sentence(f'faults: {self._faults}')
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

    def to_dataframe(self) -> Any:
        """Return a DataFrame of pandas, by the time in seconds.

        Its columns are the inputs, and each state as ``NAME``, estimated as ``NAME estimate``,
        with a deviation ``NAME std``.
        """
        state, input = self.scenario.model.state, self.scenario.model.input
        std = np.sqrt(self.covariance.diagonal(axis1=1, axis2=2))
        columns = dict(zip(state.names, self.truth.T))
        for what, values in (('estimate', self.estimate), ('std', std)):
            columns |= {f'{name} {what}': column for name, column in zip(state.names, values.T)}
        return to_dataframe(self.time.tolist(), columns | dict(zip(input.names, self.input.T)))

    def plot(self, path: str | Path | None = None, what: str = 'overview') -> Any:
        """Draw one of the pictures of the demo; the overview with the inputs, too.

        ``what`` is ``'overview'``, ``'states'``, ``'errors'``, ``'gains'``, ``'innovations'`` or
        ``'force'``.

        Returns
        -------
        The axes of a figure of matplotlib, which a notebook shows and ``plt.show()`` opens; with a
        ``path`` the figure is saved there instead, and closed.
        """
        from kalman_ros.report import run_pictures  # matplotlib is slow to load

        refuse_unknown([what], PICTURES, 'picture')
        if what == 'force' and not self.scenario.model.input.size:
            raise ValueError('plot: there is no force, for the model has no input')
        if what == 'overview':
            return run_pictures.overview(self.scenario, self, _path(path), inputs=True)
        return getattr(run_pictures, what)(self.scenario, self, _path(path))


@knows_arguments(
    T='seconds',
    duration='seconds',
    t='seconds',
    x0="overrides={'initial_state': ...}",
    u='reference: the loop computes its inputs',
)
def simulate(
    scenario: Scenario | str | Path | Mapping[str, Any] = 'mass_spring_damper_2d',
    overrides: Mapping[str, Any] | None = None,
    *,
    seconds: float = 10.0,
    seed: int = 0,
    reference: Reference = None,
    gain: ArrayLike | None = None,
    input_limit: ArrayLike | None = None,
    input_lower_limit: ArrayLike | None = None,
    input_rate_limit: ArrayLike | None = None,
) -> SimulatedRun:
    """Return the run of a loop: plant, estimator and regulator in this process, as in lockstep.

    The regulator is that of the controller node: the law of the scenario (lqr, placement, lqi
    or mpc), its limits and references.

    Parameters
    ----------
    scenario, overrides
        As for `load`; plant, estimator and controller each use their section of a file, so the
        plant may differ from their model. The plant's faults may be among them, such as
        ``{'position.dropout': 0.3}``.
    seconds
        How long.
    seed
        Of all noise.
    reference
        The state to hold: (n,), or some of it by name, ``{'x': 1.0}``, the rest at the
        equilibrium; or a function of the time in seconds that returns either.
    gain
        K (m, n), instead of the scenario's law.
    input_limit, input_lower_limit, input_rate_limit
        The largest magnitude of the input, its smallest value where that is another, and its
        largest change per second; one number for all inputs.

    Raises
    ------
    ValueError
        If an argument is invalid, or no input holds the reference.
    DesignError
        If the law has no solution.

    Examples
    --------
    >>> import kalman_ros as kr
    >>> run = kr.simulate('cart_pole', seconds=5, seed=1)
    >>> bool(kr.consistency(run))
    True
    """
    given = Given(reference, gain, limits_given(input_limit, input_lower_limit, input_rate_limit))
    loop, _ = loop_of(scenario, overrides, given, duration('seconds', seconds))
    return run_of(loop, whole('seed', seed))


def run_of(loop: Loop, seed: int) -> SimulatedRun:
    """Return the run of a loop with a seed."""
    answer = loop.answer and loop.answer()
    trajectory = closed_loop.run(
        loop.scenario, None, loop.seconds, seed, believed=loop.believed, answer=answer,
        faults=loop.faults, replaced=loop.replaced,
    )  # fmt: skip
    values = {field.name: getattr(trajectory, field.name) for field in fields(Trajectory)}
    limited = answer.limited if answer else 0
    return SimulatedRun(**values, scenario=loop.believed, limited=limited, _faults=loop.faults)
