# SPDX-License-Identifier: Apache-2.0
"""The condition on which a body is taken to stand still."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import NamedTuple


class StandStill(NamedTuple):
    """Condition that all of some fields of a message are small, and have been for a while.

    Parameters
    ----------
    fields
        Fields of the messages of the sensor that the condition is for.
    below
        Size below which each field must be, in its unit.
    duration
        Time for which they must be small, in s.
    """

    fields: tuple[str, ...]
    below: tuple[float, ...]
    duration: float


def stand_still(
    fields: Sequence[str], below: Sequence[float], watched: Sequence[str], duration: float
) -> StandStill | None:
    """Return the condition by the options of a sensor; None if there is none.

    Without fields to watch, the fields that the sensor reads are watched.

    Raises
    ------
    ValueError
        If an option is wrong; the message names it.
    """
    named = tuple(field for field in watched if field)
    if not any(isfinite(size) for size in below):
        if named:
            raise ValueError('still.fields: expected still.below beside it, in their units')
        return None
    named = named or tuple(fields)
    if len(below) != len(named):
        listed = ', '.join(named)
        raise ValueError(f'still.below: expected one for each of {listed}, got {len(below)}')
    if not all(size > 0.0 for size in below):
        got = ', '.join(f'{size:g}' for size in below)
        raise ValueError(f'still.below: expected positive sizes, got ({got})')
    return StandStill(named, tuple(map(float, below)), float(duration))
