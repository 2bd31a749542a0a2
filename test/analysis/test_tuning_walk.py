# SPDX-License-Identifier: Apache-2.0
"""The walk of a fit through a recording takes readings as the estimator does."""

from dataclasses import replace

import numpy as np
import pytest
from tuned_cases import COVERED, likelihood, recorded

CASE = replace(COVERED[0], seconds=4.0, starts={}, fitted=['model_parameters.force_noise'])


def with_noise(noise, carried=None):
    """Return the likelihood of a recording with this noise, or one that each message carries."""
    case = replace(CASE, values={**CASE.values, 'position.noise': [noise]})
    found = likelihood(case, recorded(CASE, 2))
    if carried is None:
        return found.values([found.start])[0]
    position = found.observations.readings['position']
    covariance = np.broadcast_to([[carried**2]], (len(position.stamp), 1, 1))
    readings = {'position': replace(position, covariance=covariance)}
    observations = replace(found.observations, readings=readings)
    return replace(found, observations=observations).values([found.start])[0]


def test_a_noise_that_messages_carry_counts_as_if_it_were_configured():
    own, other = with_noise(0.005), with_noise(0.02)
    assert abs(own - other) > 1.0
    assert with_noise(0.005, carried=0.02) == pytest.approx(other, rel=1e-9)
    assert with_noise(0.02, carried=0.005) == pytest.approx(own, rel=1e-9)
