# SPDX-License-Identifier: Apache-2.0
"""Chooses which values of a parametrised test run always, and which with ``--all`` alone."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def thorough(*values: Any) -> Any:
    """Return one set of values of a test that is thorough; it may have marks already."""
    (marked,) = values if len(values) == 1 and hasattr(values[0], 'marks') else (None,)
    if marked is not None:
        return pytest.param(*marked.values, marks=[*marked.marks, pytest.mark.thorough])
    return pytest.param(*values, marks=pytest.mark.thorough)


def mostly_thorough(values: Iterable[Any], *always: Any) -> list[Any]:
    """Return single ``values``, marked thorough except those that are in ``always``."""
    return [value if value in always else thorough(value) for value in values]
