# SPDX-License-Identifier: Apache-2.0
"""How fewer poles than states are completed, for regulators and observers alike."""

from __future__ import annotations

from collections.abc import Sequence

#: Each missing pole lies this much further out, relative to the fastest one given.
_STEP = 0.1


def spread_poles(name: str, poles: Sequence[float], count: int) -> list[float]:
    """Return ``count`` real parts in 1/s, the given ones first.

    The k-th missing one is (1 + k / 10) times the fastest given one, so that no pole repeats
    another, which a single input could not place.

    Raises
    ------
    ValueError
        If there are none, or more than ``count``.
    """
    given = [float(pole) for pole in poles]
    if not 1 <= len(given) <= count:
        raise ValueError(f'{name}: expected 1 to {count} numbers, got {len(given)}')
    fastest = min(given)
    return given + [fastest * (1.0 + _STEP * k) for k in range(1, count - len(given) + 1)]
