# SPDX-License-Identifier: Apache-2.0
"""Readings that lag by a constant whichever way they move: play of a gear, or dry friction."""

from __future__ import annotations

from .evidence import Evidence
from .examination import Examination
from .finding import Finding
from .hypotheses import directions
from .noise_levels import innovations
from .responses import Fit
from .units import label_of

#: A play that explains less is no finding.
_LEAST = 100.0


def find(case: Examination) -> list[Finding]:
    """Return the coordinates that are off to one side, by the direction in which they move."""
    findings = []
    for name in case.judged:
        for index in range(case.evidence.scenario.sensors[name].sensor.output.size):
            fit = _fit(case, name, index)
            if fit is not None and fit.gain > _LEAST:
                findings.append(_lagging(case, name, index, float(fit.size[0]), fit))
    return findings


def _fit(case: Examination, name: str, index: int) -> Fit | None:
    """Return the fit of an offset in the direction of the motion; None if nothing turns round."""
    return case.responses.first('play', name, str(index))


def _lagging(case: Examination, name: str, index: int, size: float, fit: Fit) -> Finding:
    """Return the finding that a coordinate is off by a ``size`` in the direction of its motion."""
    space, label = (
        case.evidence.scenario.sensors[name].sensor.output,
        label_of(case, name, (index,)),
    )

    def mended() -> Evidence:
        rows = case.passage.series('index', name)
        value = case.evidence.sensors[name].value.copy()
        value[rows, index] -= size * directions(case.evidence, case.passage, name)[:, index]
        return case.evidence.with_values(name, value)

    def again(after: Examination) -> Finding | None:
        more = _fit(after, name, index)
        if more is None or not more.remains:
            return None
        return _lagging(case, name, index, size + float(more.size[0]), more)

    side = 'behind' if size < 0.0 else 'ahead of'
    unit = f' {space.units[index]}' if space.units[index] else ''
    return Finding(
        'backlash', label,
        f'readings of {label} are {abs(size):.4g} ± {fit.std[0]:.1g}{unit} {side} the motion, '
        f'whichever way it goes: a play of {2.0 * abs(size):.3g}{unit} in a gear or linkage, or '
        'dry friction.',
        fit.gain**0.5, gain=fit.gain, figure=innovations(case, name, index), mended=mended,
        again=again,
    )  # fmt: skip
