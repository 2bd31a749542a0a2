# SPDX-License-Identifier: Apache-2.0
"""Results that answer a wrong name with the right ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, NoReturn


class KnownNames:
    """A result whose error for an unknown attribute lists the attributes that it has."""

    if not TYPE_CHECKING:  # a type checker would take every name as known

        def __getattr__(self, name: str) -> NoReturn:
            kind = type(self)
            if name.startswith('_'):  # asked for by Python and numpy, not by a person
                raise AttributeError(name)
            known = {*dir(kind), *getattr(kind, '__dataclass_fields__', ())}
            listed = ', '.join(sorted(each for each in known if not each.startswith('_')))
            raise AttributeError(f"{kind.__name__} has no '{name}'; it has {listed}")
