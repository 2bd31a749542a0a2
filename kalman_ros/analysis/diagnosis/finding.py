# SPDX-License-Identifier: Apache-2.0
"""Findings of a diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import nan
from typing import Any, NamedTuple

from kalman_ros.core import Array

from .evidence import Evidence
from .passage import Passage


@dataclass(frozen=True)
class Curve:
    """A curve of a picture: ``x`` and ``y`` (N,), and a style ('line', 'dots' or 'bound')."""

    label: str
    x: Array
    y: Array
    style: str = 'line'


@dataclass(frozen=True)
class Figure:
    """The evidence of a finding as a picture: a title, the labels of its axes, and curves."""

    title: str
    across: str
    up: str
    curves: tuple[Curve, ...]


class NoiseLevel(NamedTuple):
    """A changed noise of a sensor.

    Parameters
    ----------
    sensor, indices
        Sensor, and its coordinates whose noise is changed.
    before, after
        Standard deviations (k,).
    spread
        Half of the interval of the factor between them, of its logarithm.
    """

    sensor: str
    indices: Sequence[int]
    before: Array
    after: Array
    spread: float


class DensityLevel(NamedTuple):
    """A changed process noise.

    Parameters
    ----------
    name
        Name of the parameter.
    factor
        Factor of its root.
    spread
        Half of the interval of the factor, of its logarithm.
    change
        Parameters that change it.
    """

    name: str
    factor: float
    spread: float
    change: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Finding:
    """A fault of a recording or of the parameters.

    Parameters
    ----------
    kind
        Kind of the fault in a few words, such as 'bias' or 'process noise too small'.
    subject
        Sensor, coordinate of a sensor, or parameter.
    sentence
        Description of the fault, with measured numbers, and of the remedy.
    z
        Significance in standard deviations of pure chance; infinite if chance cannot cause it.
    change
        Values of the parameter file to change, by name; empty if no change corrects the fault.
    gain
        Reduction of the misfit, -2 log likelihood, by the correction.
    share
        The gain as a share of the misfit that all findings together explain.
    proof
        Reduction of the misfit of a replay of the first seconds by the change alone; NaN without a
        change.
    figure
        Evidence as a picture.
    same_as
        Other findings (kind, subject) that explain these data equally well.
    silent
        Whether a sensor has no usable reading, so that no likelihood measures its effect.
    plain
        Whether it shows without a filter, and others follow from it.
    dues
        Cost of the correction in -2 log likelihood, in addition to the misfit after it.
    certainty
        Posterior share of this cause, with those that fit as well, among those that were tried,
        times the share of the misfit that it explains.
    most
        Largest certainty of a cause of this kind.
    parameters
        The number of fitted numbers; each costs the logarithm of the number of values read.
    note
        Whether it is no fault, so that the recording may be in order.
    again
        Function that returns the finding with another size, from the examination after its
        correction; None if there is nothing left to correct.
    is_exact
        Whether ``gain`` is exact.
    instead
        Function that returns the finding with another consequence, to be tried beside
        offsets.
    exact
        Function that returns the finding with its exact gain, where ``gain`` is a prediction that
        a corrected pass cannot check; None otherwise.
    mended
        Function that returns the corrected evidence, for the search for further faults; None if
        the evidence needs no correction.
    passage
        Filter pass over the corrected evidence, if it is already known.
    absorbs
        Whether its correction takes other causes with it, so that the search goes on without.
    level
        Noise that it changes, if it is about the noise of a sensor.
    density
        Process noise that it changes, if it is about one.
    """

    kind: str
    subject: str
    sentence: str
    z: float
    change: Mapping[str, Any] = field(default_factory=dict)
    gain: float = 0.0
    share: float = 0.0
    proof: float = nan
    figure: Figure | None = None
    same_as: tuple[tuple[str, str], ...] = ()
    silent: bool = False
    plain: bool = False
    dues: float = 0.0
    certainty: float = 1.0
    most: float = 1.0
    parameters: float = 1.0
    note: bool = False
    again: Callable[[Any], Finding | None] | None = field(default=None, repr=False, compare=False)
    exact: Callable[[], Finding] | None = field(default=None, repr=False, compare=False)
    instead: Callable[[], Finding] | None = field(default=None, repr=False, compare=False)
    is_exact: bool = False
    mended: Callable[[], Evidence] | None = field(default=None, repr=False, compare=False)
    passage: Passage | None = field(default=None, repr=False, compare=False)
    absorbs: bool = False
    level: NoiseLevel | None = field(default=None, repr=False, compare=False)
    density: DensityLevel | None = field(default=None, repr=False, compare=False)

    @property
    def concerned(self) -> tuple[str, ...]:
        """Sensors whose readings it changes, or what is no sensor."""
        if self.kind == 'parameter':  # which may be that of a sensor
            return (self.subject,)
        return tuple(subject.partition('.')[0] for subject in self.subject.split(' and '))

    @property
    def cautious(self) -> bool:
        """Whether it makes the filter less sure than it could be, and nothing wrong."""
        return self.kind.endswith('too large')
