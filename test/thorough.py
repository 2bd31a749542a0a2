# SPDX-License-Identifier: Apache-2.0
"""Chooses which values of a parametrised test run always, and which with ``--all`` alone."""

import pytest


def mostly_thorough(values, *always):
    """Return ``values``, marked thorough except those that are in ``always``."""
    return [
        value if value in always else pytest.param(value, marks=pytest.mark.thorough)
        for value in values
    ]
