# SPDX-License-Identifier: Apache-2.0
"""States that the readings of a recording do not observe, and since when."""

from __future__ import annotations

from math import inf

import numpy as np

from .examination import Examination
from .finding import Curve, Figure, Finding

#: A state is lost if its deviation, in the last tenth, is above that of the start by this factor.
_GROWN = 1.0
#: Parts into which a recording is divided.
_PARTS = 50


def find(case: Examination) -> list[Finding]:
    """Return the states that are known no better at the end than at the start, as notes.

    Along the path, the covariance of the filter is the inverse of the information of the first
    belief and of all readings, less what process noise takes away.
    """
    events, space = case.passage.events, case.evidence.scenario.model.state
    shown = events[:: max(1, len(events) // _PARTS)]
    when = np.array([event.time for event in shown]) - case.evidence.start
    std = np.sqrt(np.array([event.P.diagonal() for event in shown]))
    first = case.evidence.scenario.initial_belief.std
    found = []
    for index, name in enumerate(space.names):
        known = np.flatnonzero(std[:, index] <= _GROWN * max(first[index], 1e-9))
        if len(known) and known[-1] >= 0.9 * len(shown):
            continue
        since = when[known[-1]] if len(known) else 0.0
        figure = Figure(f'{name}: its deviation', 'time [s]', space.label(name),
                        (Curve('1 sigma', when, std[:, index]),))  # fmt: skip
        found.append(
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
    return found
