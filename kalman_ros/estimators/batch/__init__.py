# SPDX-License-Identifier: Apache-2.0
"""Filters for any number of beliefs, or sets of parameters, at once."""

from .batch_correction import BatchCorrection
from .batch_estimator import BatchEstimator
from .batch_filters import BatchFilter, batched, batched_candidates
from .candidates import candidate_sensor

__all__ = [
    'BatchCorrection',
    'BatchEstimator',
    'BatchFilter',
    'batched',
    'batched_candidates',
    'candidate_sensor',
]
