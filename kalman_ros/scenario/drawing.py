# SPDX-License-Identifier: Apache-2.0
"""How a model is drawn by the live page and in animations."""

from __future__ import annotations

from typing import NamedTuple

from kalman_ros.core import Space

#: Models with a special drawing; others are drawn in the plane, or as bars or curves.
_DRAWINGS = {
    'mass_spring_damper': 'spring',
    'mass_spring_damper_2d': 'springs',
    'cart_pole': 'cart_pole',
    'dc_motor': 'motor',
    'submersible': 'submersible',
}
#: Names of headings.
_HEADINGS = ('psi', 'yaw', 'theta')


class Drawing(NamedTuple):
    """The kind of a drawing, and the name of the state that is a heading, if there is one."""

    kind: str
    heading: str | None


def drawing(model: str, state: Space) -> Drawing:
    """Return how a model with this name and this state is drawn."""
    kind = _DRAWINGS.get(model)
    if kind is None:
        kind = 'plane' if {'x', 'y'} <= {*state.names} else 'bars'
    return Drawing(kind, next((name for name in _HEADINGS if name in state.angles), None))
