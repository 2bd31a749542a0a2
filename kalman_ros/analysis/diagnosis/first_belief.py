# SPDX-License-Identifier: Apache-2.0
"""Initial beliefs with a covariance that is too small."""

from __future__ import annotations

import numpy as np

from .examination import CHANCE, Examination
from .finding import Finding


def find(case: Examination) -> list[Finding]:
    """Return a finding if the error of the initial belief exceeds its covariance."""
    columns = case.responses.columns('first')
    if not columns:
        return []
    fit = case.responses.together(columns)
    if fit.gain < CHANCE + 2.0 * len(columns):
        return []
    belief, space = case.evidence.scenario.initial_belief, case.evidence.scenario.model.state
    significant = np.abs(fit.size) > 3.0 * fit.std
    if not significant.any():
        return []
    error = np.where(significant, np.abs(fit.size), 0.0)
    worst = int(np.argmax(error))
    std = belief.std * np.maximum(1.0, 1.2 * error)
    if error[worst] < 1.5:
        return []
    change = {'initial_std': [float(f'{value:.3g}') for value in std]}
    return [
        Finding(
            'initial belief too narrow',
            'initial_std',
            f'at the start {space.names[worst]} was {error[worst]:.3g} standard deviations from '
            f'initial_estimate ({belief.mean[worst]:g} ± {belief.std[worst]:.3g}): widen '
            'initial_std, or start from the first reading (initialize: reading).',
            fit.gain**0.5,
            change,
            gain=fit.gain,
            mended=lambda: case.evidence.adopting(change),
        )
    ]
