# SPDX-License-Identifier: Apache-2.0
"""Pictures of the findings of a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from kalman_ros.analysis.diagnosis.finding import Figure, Finding

from .style import BOUND, ESTIMATE, INPUT, READING, figure_with

_COLOURS = (READING, ESTIMATE, INPUT, BOUND)


def draw(findings: Sequence[Finding], folder: Path) -> list[Path]:
    """Draw the evidence of each finding that has a picture, and return the files.

    The files of an earlier diagnosis are removed.
    """
    for path in folder.glob('[0-9][0-9]-*.png'):
        path.unlink()
    drawn = []
    for number, finding in enumerate(findings, start=1):
        if finding.figure is not None:
            path = folder / f'{number:02d}-{finding.kind.replace(" ", "-")}.png'
            figure(finding.figure, path)
            drawn.append(path)
    return drawn


def figure(shown: Figure, path: Path | None) -> Any:
    """Draw the curves of a figure, and return the axes (1, 1)."""
    with figure_with(path, 1, 1, (8.0, 3.0)) as (_, axes):
        axis = axes[0, 0]
        for curve, colour in zip(shown.curves, _COLOURS):
            if curve.style == 'dots':
                axis.plot(curve.x, curve.y, '.', ms=3.0, color=colour, label=curve.label)
            elif curve.style == 'bound':
                axis.plot(curve.x, curve.y, color=BOUND, lw=1.0, label=curve.label or None)
            else:
                axis.plot(curve.x, curve.y, color=colour, lw=1.2, label=curve.label)
        axis.set_title(shown.title)
        axis.set_xlabel(shown.across)
        axis.set_ylabel(shown.up)
        axis.legend(loc='best')
    return axes
