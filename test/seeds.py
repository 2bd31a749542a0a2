# SPDX-License-Identifier: Apache-2.0
"""Random cases of which the inner loop tries only the first few."""

import pytest


def first_fast(cases, fast):
    """Return the cases as parameters, those after the first ``fast`` marked slow."""
    return [
        pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=marks)
        for number, case in enumerate(cases)
        for marks in [[pytest.mark.slow] * (number >= fast)]
    ]
