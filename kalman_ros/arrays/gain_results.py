# SPDX-License-Identifier: Apache-2.0
"""Gains that print their properties and act as matrices in arithmetic."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from kalman_ros.control.lqe import LqeDesign
from kalman_ros.control.margins import DiskMargin, Margins, loop_at_a_time
from kalman_ros.control.simultaneous import simultaneous_disk
from kalman_ros.control.state_space import StateSpace
from kalman_ros.core import Array
from kalman_ros.core.known_names import KnownNames
from kalman_ros.linear.structure import ComplexArray, is_stable

from . import text
from .accept import Plant


class _Gain(KnownNames, NDArrayOperatorsMixin):
    """A result whose ``matrix`` takes its place in arithmetic: ``A - B @ gain``, ``-gain @ x``."""

    @property
    def matrix(self) -> Array:
        """The gain."""
        raise NotImplementedError

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return np.array(self.matrix, dtype=dtype)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        plain = [item.matrix if isinstance(item, _Gain) else item for item in inputs]
        return getattr(ufunc, method)(*plain, **options)

    def __iter__(self) -> Iterator[Any]:
        raise NotImplementedError

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the gain."""
        return self.matrix.shape

    @property
    def T(self) -> Array:  # noqa: N802
        """The gain, transposed."""
        transposed: Array = self.matrix.T
        return transposed

    def __len__(self) -> int:
        """Return the number of parts that unpacking gives."""
        return sum(1 for _ in self)  # tuple would ask for the length

    def __getitem__(self, key: Any) -> Any:
        """Return a part by its position in unpacking; of two indices, that of the matrix."""
        return self.matrix[key] if isinstance(key, tuple) else tuple(self)[key]


@dataclass(frozen=True, eq=False, repr=False)
class StateFeedback(_Gain):
    """u = -K x. ``K, S, poles = gain`` unpacks it, and in arithmetic it is K.

    Parameters
    ----------
    plant
        The system that the gain controls.
    gain
        K (m, n).
    poles
        Eigenvalues of A - B K (n,), or of F - G K if sampled.
    cost_to_go
        S (n, n): the least cost from x on is x'S x. None if the gain minimises no cost.
    """

    plant: Plant
    gain: Array
    poles: ComplexArray
    cost_to_go: Array | None = None

    @property
    def matrix(self) -> Array:
        """K."""
        return self.gain

    @property
    def K(self) -> Array:  # noqa: N802
        """The ``gain``, as in python-control."""
        return self.gain

    @property
    def S(self) -> Array | None:  # noqa: N802
        """The ``cost_to_go``, as in python-control."""
        return self.cost_to_go

    @property
    def E(self) -> ComplexArray:  # noqa: N802
        """The ``poles``, as in python-control."""
        return self.poles

    @property
    def dt(self) -> float | None:
        """Seconds for which an input is held; None in continuous time."""
        return self.plant.dt

    @cached_property
    def margins(self) -> LoopMargins:
        """The margins at each input, with the other inputs' loops closed.

        Raises
        ------
        DesignError
            If the closed loop is not stable.
        """
        return LoopMargins.of(self._loop)

    @property
    def _loop(self) -> StateSpace:
        m = len(self.gain)
        return StateSpace(self.plant.A, self.plant.B, self.gain, np.zeros((m, m)), self.dt)

    def plot(self, path: str | Path | None = None) -> None:
        """Draw Bode and Nyquist plots of the loop at each input, with its margins.

        With a ``path`` the picture is saved there; else a notebook or ``plt.show()`` shows it.

        Raises
        ------
        DesignError
            If the closed loop is not stable.
        """
        _plot_loops(self.plant.inputs, self.margins, path, 'u = -K x')

    def __iter__(self) -> Iterator[Any]:
        return iter((self.gain, self.cost_to_go, self.poles))

    def __repr__(self) -> str:
        plant, sampled = self.plant, self.dt is not None
        how = f', the input held for {self.dt:g} s' if sampled else ', in continuous time'
        lines = [f'State feedback u = -K x{how}']
        lines += text.matrix([f'K {u}' for u in plant.inputs], plant.states, self.gain)
        lines += text.sentence(f'poles [{"z" if sampled else "1/s"}] {text.poles(self.poles)}')
        if self.cost_to_go is not None:
            lines += text.matrix([f'S {x}' for x in plant.states], plant.states, self.cost_to_go)
        m, n = self.gain.shape
        if not is_stable(plant.A - plant.B @ self.gain, sampled=sampled):
            lines += ['the closed loop is not stable']
        elif m * n**3 > _AT_ONCE and 'margins' not in vars(self):
            lines += [f'margins: .margins computes them, with {n} states not at once']
        else:
            for name, at in zip(plant.inputs, self.margins):
                lines += text.sentence(f'margins at {name}: {at}')
            for together in self.margins.together:
                lines += text.sentence(f'margins at {together}')
        return '\n'.join(lines)


#: Margins are printed at once if the inputs times the cube of the states are no more: 3 s.
_AT_ONCE = 1_500_000
#: Names of python-control and MATLAB.
_MARGINS = {
    **dict.fromkeys(('gm', 'gain_margin', 'GainMargin', 'gain'), '.upper_gain.value'),
    **dict.fromkeys(('pm', 'phase_margin', 'PhaseMargin', 'phase'), '.lag.value, in rad'),
    **dict.fromkeys(('dm', 'delay_margin', 'DelayMargin'), '.delay.value'),
    **dict.fromkeys(('wcg', 'wpc', 'GMFrequency'), '.upper_gain.frequency'),
    **dict.fromkeys(('wcp', 'wgc', 'PMFrequency'), '.lag.frequency'),
    **dict.fromkeys(('sm', 'stability_margin', 'modulus_margin'), '.distance.value'),
}


@dataclass(frozen=True, repr=False)
class InputMargins(KnownNames, Margins):
    """The margins of a loop at one input.

    Parameters
    ----------
    loop
        The loop (1, 1), opened there.
    """

    other_names = _MARGINS

    loop: StateSpace = field(compare=False)

    def __repr__(self) -> str:
        return '\n'.join(text.clauses(str(self)))

    def plot(self, path: str | Path | None = None) -> None:
        """Draw Bode and Nyquist plots of the loop with its margins.

        With a ``path`` the picture is saved there; else a notebook or ``plt.show()`` shows it.
        """
        _plot_loops(('the input',), [self], path)


class LoopMargins(tuple[InputMargins, ...]):
    """The margins at each input, in order, of changes there alone; they print one per line."""

    all_at_once: DiskMargin
    """The change that all inputs tolerate together, which may be far smaller."""

    @classmethod
    def of(cls, loop: StateSpace) -> LoopMargins:
        """Return the margins of a loop L (m, m); DesignError if it is not stable when closed."""
        margins = cls(
            InputMargins(**vars(at), loop=loop.channel(k))
            for k, at in enumerate(loop_at_a_time(loop))
        )
        margins.all_at_once = simultaneous_disk(loop)
        return margins

    def plot(self, path: str | Path | None = None) -> None:
        """Draw Bode and Nyquist plots of the loop at each input, as those of one."""
        _plot_loops([f'input {index}' for index in range(len(self))], self, path)

    def __repr__(self) -> str:
        lines = [*(f'input {index}: {at}' for index, at in enumerate(self)), *self.together]
        return '\n'.join(line for sentence in lines for line in text.clauses(sentence))

    @property
    def together(self) -> list[str]:
        """What all inputs tolerate together, as lines of text; none if there is one input."""
        if len(self) < 2:
            return []
        # 2 is an end, beyond which rounding would print gains of 1e15
        disk = replace(self.all_at_once, alpha=round(self.all_at_once.alpha, 5))
        return [
            f'all inputs at once: gain {disk.lower_gain:.3g} to {disk.upper_gain:.3g}, '
            f'phase ±{np.degrees(disk.phase):.3g} deg, disk {disk.alpha:.3g}'
        ]


def _plot_loops(
    names: Sequence[str],
    margins: Sequence[InputMargins],
    path: str | Path | None,
    label: str = 'the loop',
) -> None:
    from kalman_ros.analysis.input_loops import InputLoops, Loop
    from kalman_ros.report.design_pictures import feedback_loops  # matplotlib is slow to load

    channels = [
        InputLoops(name, Loop(at.loop, at, at), None, None) for name, at in zip(names, margins)
    ]
    dt = margins[0].loop.dt
    rate = inf if dt is None else 1.0 / dt
    feedback_loops(channels, rate, None if path is None else Path(path), (label, ''))


@dataclass(frozen=True, eq=False, repr=False)
class Observer(_Gain, LqeDesign):
    """The steady-state Kalman filter. ``L, P, poles = gain`` unpacks it as python-control does.

    In arithmetic it is the predictor's gain, so that F - L C has the poles.

    Parameters
    ----------
    gain, predictor_gain, covariance, prior, poles
        As of `LqeDesign`.
    states, readings
        Their names.
    dt
        Seconds between readings; None in continuous time.
    response
        From the readings to the estimate, after each of them (n, k).
    """

    other_names: ClassVar[Mapping[str, str]] = {'K': '.L'}

    states: tuple[str, ...] = ()
    readings: tuple[str, ...] = ()
    dt: float | None = None
    response: StateSpace | None = None

    @property
    def matrix(self) -> Array:
        """The predictor's gain."""
        return self.predictor_gain

    @property
    def L(self) -> Array:  # noqa: N802
        """The ``predictor_gain``, as in python-control."""
        return self.predictor_gain

    @property
    def P(self) -> Array:  # noqa: N802
        """The ``prior`` covariance, as in python-control."""
        return self.prior

    @property
    def E(self) -> ComplexArray:  # noqa: N802
        """The ``poles``, as in python-control."""
        return self.poles

    def __iter__(self) -> Iterator[Any]:
        return iter((self.predictor_gain, self.prior, self.poles))

    def plot(self, path: str | Path | None = None) -> None:
        """Draw how much of a reading is in the estimate of each state, by frequency.

        With a ``path`` the picture is saved there; else a notebook or ``plt.show()`` shows it.
        """
        from kalman_ros.report.design_pictures import estimator_response  # slow to load

        assert self.response is not None
        estimator_response(self.response, self.states, None if path is None else Path(path))

    def __repr__(self) -> str:
        sampled = self.dt is not None
        law = 'x += gain (y - C x)' if sampled else 'dx/dt = A x + B u + L (y - C x)'
        how = f', a reading every {self.dt:g} s' if sampled else ', in continuous time'
        lines = [f'Steady-state Kalman filter {law}{how}']
        name = 'gain' if sampled else 'L'
        lines += text.matrix([f'{name} {x}' for x in self.states], self.readings, self.gain)
        if sampled:
            lines += ['L = F gain, that of the predictor, also in arithmetic and in unpacking:']
            lines += text.matrix(
                [f'L {x}' for x in self.states], self.readings, self.predictor_gain
            )
        lines += text.sentence(f'poles [{"z" if sampled else "1/s"}] {text.poles(self.poles)}')
        std = np.sqrt(self.covariance.diagonal()).tolist()
        errors = ', '.join(f'{x} {text.number(s)}' for x, s in zip(self.states, std))
        return '\n'.join([*lines, *text.sentence(f'standard deviation of the error: {errors}')])


class _Sampled(NamedTuple):
    F: Array
    G: Array
    Q: Array
    dt: float


class Sampled(_Sampled):
    """x' = F x + G u + w, w ~ N(0, Q). ``F, G, Q, dt = sampled`` unpacks it.

    Parameters
    ----------
    F, G, Q
        Matrices (n, n), (n, m) and (n, n).
    dt
        Seconds of a sample.
    """

    states: tuple[str, ...]
    """Names of the states."""
    inputs: tuple[str, ...]
    """Names of the inputs."""

    @classmethod
    def of(cls, step: Sequence[Array], dt: float, plant: Plant) -> Sampled:
        """Return the step of a plant: (F, G, Q), each in samples of ``dt`` seconds."""
        F, G, Q = step
        # what is less than the rounding of B dt is nothing
        G = np.where(np.abs(G) < text.ROUNDING * dt * np.max(np.abs(plant.B), initial=0.0), 0.0, G)
        sampled = cls(F, G, Q, dt)
        sampled.states, sampled.inputs = plant.states, plant.inputs
        return sampled

    @property
    def A(self) -> Array:  # noqa: N802
        """F, by the letter that systems in discrete time have elsewhere."""
        return self.F

    @property
    def B(self) -> Array:  # noqa: N802
        """G, by the letter that systems in discrete time have elsewhere."""
        return self.G

    def __repr__(self) -> str:
        x, u = self.states, self.inputs
        lines = [f"x' = F x + G u + w, w ~ N(0, Q), in samples of {self.dt:g} s"]
        for name, values, head in (('F', self.F, x), ('G', self.G, u), ('Q', self.Q, x)):
            if values.size:
                lines += text.matrix([f'{name} {row}' for row in x], head, values)
        return '\n'.join(lines)
