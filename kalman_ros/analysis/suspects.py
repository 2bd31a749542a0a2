# SPDX-License-Identifier: Apache-2.0
"""Likely causes of the failed checks of a run."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from .checks import Check

#: The start of a check's name, with the causes of values that are too large and too small.
_SUSPECTS = (
    (
        'NIS of ',
        'Innovations of {what} are larger than expected: suspect a {what}.noise that is too '
        'small, a bias or outliers of {what}, or the model.',
        'Innovations of {what} are smaller than expected: suspect a {what}.noise that is too '
        'large.',
    ),
    (
        'NEES',
        'Errors are larger than the covariance says: suspect process noise or sensor noise that '
        'is configured too small, a bias, or the model.',
        'Errors are smaller than the covariance says: suspect noise that is configured too large.',
    ),
    (
        'RMS error of ',
        'The estimate of {what} is worse than predicted: suspect a bias or the noise of a sensor, '
        'or the model.',
        'The estimate of {what} is better than predicted: suspect noise that is configured too '
        'large.',
    ),
    (
        'largest error of ',
        'The estimate of {what} is biased or its covariance too small: suspect a bias of a '
        'sensor, the model, or its process noise.',
        '',
    ),
    (
        'regulator dynamics',
        'The loop responds differently from its design: suspect a parameter of the model, the '
        'actuator, or a delay.',
        'The loop responds more regularly than noise allows: suspect the process noise.',
    ),
    (
        'estimator dynamics',
        'Errors decay differently from the design of the filter: suspect the noise parameters.',
        'Errors decay more regularly than noise allows: suspect the process noise.',
    ),
    (
        'RMS of ',
        '{what} moves more than predicted: suspect a disturbance, the process noise, or the '
        'model.',
        '{what} moves less than predicted: suspect the process noise.',
    ),
)


def suspects(checks: Sequence[Check]) -> list[str]:
    """Return the likely causes of failed checks, one sentence each."""
    sentences = []
    for start, large, small in _SUSPECTS:
        for check in checks:
            if check.passed or not check.counts or not check.name.startswith(start):
                continue
            subject, value = check.name[len(start) :].partition(' / ')[0], check.measured.real
            if isfinite(value):
                sentences.append((large if value > check.high else small).format(what=subject))
            elif start == 'NIS of ':
                sentences.append(
                    f'No reading of {subject} was fused: suspect its topic or its gate.'
                )
    return [sentence for sentence in dict.fromkeys(sentences) if sentence]
