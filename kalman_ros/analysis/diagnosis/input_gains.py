# SPDX-License-Identifier: Apache-2.0
"""Inputs that act with another gain, or with the wrong sign: some of them, or all alike."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kalman_ros.core import Array

from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Finding
from .responses import Fit

#: A gain that differs from 1 by less than the first number, or by less than the second number of
#: standard deviations, is no finding.
_RELEVANT, _SHOWN = 0.05, 3.0
#: A gain of 1 plus this number or less has the wrong sign.
_REVERSED = -1.3


def find(case: Examination) -> list[Finding]:
    """Return the inputs that act with the wrong sign, or with another gain."""
    names = case.evidence.scenario.model.input.names
    columns = {i: case.responses.columns('gain', name) for i, name in enumerate(names)}
    alone = {i: case.responses.alone(indices[0]) for i, indices in columns.items() if indices}
    shown = {i: float(fit.size[0]) for i, fit in alone.items() if fit.gain >= CHANCE}
    reversed = [i for i, size in shown.items() if size < _REVERSED]
    others = [i for i, size in shown.items() if abs(size) >= _RELEVANT and size >= _REVERSED]
    findings = [*_acting(case, 'input sign', reversed), *_acting(case, 'input gain', others)]
    if 1 < len(names) == len(alone):
        findings += _acting(case, 'input gain', [*alone], alike=True)
    return findings


def _acting(
    case: Examination, kind: str, indices: Sequence[int], alike: bool = False
) -> list[Finding]:
    """Return the finding that inputs act with other gains, which are fitted together.

    They have one gain if they are ``alike``. Otherwise those are left out whose gain is not shown
    beside the others.
    """
    if not indices:
        return []
    fit, gains, std = _fitted(case, indices, alike)
    least = np.maximum(_RELEVANT, _SHOWN * std)
    kept = [i for i, far in zip(indices, np.abs(gains - 1.0) >= least) if far]
    if len(kept) < len(indices):
        return [] if alike else _acting(case, kind, kept)
    if fit.gain < CHANCE:
        return []
    return [_finding(case.evidence, kind, indices, gains, std, fit.gain, alike)]


def _fitted(case: Examination, indices: Sequence[int], alike: bool) -> tuple[Fit, Array, Array]:
    """Return the fit of the gains of some inputs, the gains and their standard deviations."""
    names = case.evidence.scenario.model.input.names
    columns = [case.responses.columns('gain', names[index])[0] for index in indices]
    basis = np.ones((len(columns), 1)) if alike else np.eye(len(columns))
    fit = case.responses.fit(basis, columns)
    return fit, 1.0 + basis @ fit.size, basis @ fit.std


def _finding(
    evidence: Evidence,
    kind: str,
    indices: Sequence[int],
    gains: Array,
    std: Array,
    gain: float,
    alike: bool,
) -> Finding:
    """Return the finding that inputs act with these gains."""

    def again(after: Examination) -> Finding | None:
        """Return the gains with what remains of them."""
        fit, more, nearer = _fitted(after, indices, alike)
        if not fit.remains:
            return None
        return _finding(evidence, kind, indices, gains * more, gains * nearer, gain, alike)

    names, value = evidence.scenario.model.input.names, evidence.inputs.value.copy()
    value[:, list(indices)] *= gains
    mended = evidence.with_inputs(value)
    words = [
        f'{names[i]} with the wrong sign' if kind == 'input sign'
        else f'{names[i]} at {share:.4g} ± {about:.1g} of its command'
        for i, share, about in zip(indices, gains.tolist(), std.tolist())
    ]  # fmt: skip
    if alike:
        words = [f'all of it at {gains[0]:.4g} ± {std[0]:.1g} of its command']
    return Finding(
        kind, names[indices[0]],
        f'the input does not act as commanded: {", ".join(words)}.', gain**0.5,
        gain=gain, parameters=1 if alike else len(indices), mended=lambda: mended, again=again,
    )  # fmt: skip
