# SPDX-License-Identifier: Apache-2.0
"""Results that answer a wrong name with the right ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, NoReturn

from .named_options import nearest


class KnownNames:
    """A result whose error for an unknown attribute names the right one, or lists all."""

    __slots__ = ()
    #: Names that attributes have in other libraries, each with the attribute of this result.
    other_names: ClassVar[Mapping[str, str]] = {}

    if not TYPE_CHECKING:  # a type checker would take every name as known

        def __getattr__(self, name: str) -> NoReturn:
            kind = type(self)
            if name.startswith('_'):  # asked for by Python and numpy, not by a person
                raise AttributeError(name)
            if name in self.other_names:
                here = self.other_names[name]
                raise AttributeError(f"{kind.__name__} has no '{name}'; here it is {here}")
            known = {*dir(kind), *getattr(kind, '__dataclass_fields__', ())}
            known -= {'other_names', *(dir(tuple) if isinstance(self, tuple) else ())}
            public = sorted(attribute for attribute in known if not attribute.startswith('_'))
            hint = nearest(name, public) or f'it has {", ".join(public)}'
            raise AttributeError(f"{kind.__name__} has no '{name}'; {hint}")
