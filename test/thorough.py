# SPDX-License-Identifier: Apache-2.0
"""Chooses which values of a parametrised test run always, and which with ``--all`` alone."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def thorough(*values: Any) -> Any:
    """Return one set of values of a test that is thorough."""
    return pytest.param(*values, marks=pytest.mark.thorough)


def mostly_thorough(values: Iterable[Any], *always: Any) -> list[Any]:
    """Return single ``values``, marked thorough except those that are in ``always``."""
    return [value if value in always else thorough(value) for value in values]
