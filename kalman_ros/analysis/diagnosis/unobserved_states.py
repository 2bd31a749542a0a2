# SPDX-License-Identifier: Apache-2.0
"""States that the readings of a recording do not observe, and the start of that time."""

from __future__ import annotations

from math import inf

import numpy as np

from kalman_ros.core import Array

from .examination import Examination
from .finding import Curve, Figure, Finding
from .passage import Passage

#: A state is unobserved if its deviation in the last tenth exceeds this multiple of the first.
_GROWN = 1.0
#: Number of parts, approximately, of which the smallest deviations count.
_PARTS = 50


def find(case: Examination) -> list[Finding]:
    """Return the states that are less certain at the end than at the start, as notes.

    Along the path, the covariance of the filter is the inverse of the information of the initial
    belief and of all readings, reduced by the process noise.
    """
    passage, space = case.passage, case.evidence.scenario.model.state
    starts = np.arange(0, len(passage.events), max(1, len(passage.events) // _PARTS))
    times = passage.series('time')[starts] - case.evidence.start
    std = np.sqrt(np.minimum.reduceat(_variances(passage), starts, axis=0))
    first = case.evidence.scenario.initial_belief.std
    findings = []
    for index, name in enumerate(space.names):
        known = np.flatnonzero(std[:, index] <= _GROWN * max(first[index], 1e-9))
        if len(known) and known[-1] >= 0.9 * len(times):
            continue
        since = max(times[known[-1]], 0.0) if len(known) else 0.0
        figure = Figure(f'{name}: its deviation', 'time [s]', space.label(name),
                        (Curve('1 sigma', times, std[:, index]),))  # fmt: skip
        findings.append(
            Finding(
                'not observed',
                name,
                f'these readings do not observe {space.label(name)}: its standard deviation '
                f'grows from {first[index]:.3g} to {std[-1, index]:.3g}, and is larger than at '
                f'the start from t = {since:.3g} s on. Add a sensor that depends on it.',
                inf,
                figure=figure,
            )
        )
    return findings


def _variances(passage: Passage) -> Array:
    """Return the variances of the states after each event (E, n)."""
    variances = passage.series('P').diagonal(axis1=1, axis2=2).copy()
    for name in passage.names:
        K, S = passage.series('K', name), passage.series('S', name)
        variances[passage.of(name)] -= np.einsum('eij,ejk,eik->ei', K, S, K)
    return np.asarray(np.maximum(variances, 0.0))
