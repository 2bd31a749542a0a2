# SPDX-License-Identifier: Apache-2.0
"""What a diagnosis finds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import nan
from typing import Any

from kalman_ros.core import Array

from .evidence import Evidence
from .passage import Passage


@dataclass(frozen=True)
class Curve:
    """A curve of a picture: ``x`` and ``y`` (N,), a style ('line', 'dots' or 'bound')."""

    label: str
    x: Array
    y: Array
    style: str = 'line'


@dataclass(frozen=True)
class Figure:
    """The evidence of a finding, as a picture: a title, the names of its axes, and curves."""

    title: str
    across: str
    up: str
    curves: tuple[Curve, ...]


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong with a recording or with the parameters.

    Parameters
    ----------
    kind
        What is wrong, in a few words: 'bias', 'process noise too small'.
    subject
        The sensor, the coordinate of one, or the parameter.
    sentence
        What was measured, with numbers, and what to do.
    z
        By how many standard deviations of pure chance this differs from nothing; infinite for
        what chance never does.
    change
        Lines of the parameter file to change, name to value; empty if none mends it.
    gain
        By how much the misfit, -2 log likelihood, becomes smaller once this is corrected.
    share
        The same as a part of the misfit that all findings together explain.
    proof
        By how much a replay of the first seconds, with the change alone, reduces their misfit; NaN
        without a change.
    figure
        The evidence as a picture.
    same_as
        Other (kind, subject) that explain these data as well, so that the data do not decide.
    silent
        Nothing usable comes from a sensor: what it would have explained, no likelihood says.
    dues
        What the correction itself costs in -2 log likelihood, beside the misfit after it.
    mended
        Returns the evidence with this corrected, for the search for what else is wrong; None
        where nothing needs to be.
    passage
        The pass over the corrected evidence, where it is known already.
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
    dues: float = 0.0
    mended: Callable[[], Evidence] | None = field(default=None, repr=False, compare=False)
    passage: Passage | None = field(default=None, repr=False, compare=False)
