# SPDX-License-Identifier: Apache-2.0
"""Signatures with the types as the source has them: ArrayLike, not all of its parts."""

import inspect

from sphinx.application import Sphinx


class _AsWritten:
    """An annotation that is shown as its text."""

    def __init__(self, text):
        self._text = text

    def __repr__(self):
        return self._text


def _signature(app, what, name, obj, options, signature, return_annotation):
    if what not in ('function', 'class', 'method', 'exception'):
        return None
    try:
        found = inspect.signature(obj)
    except (TypeError, ValueError):
        return None
    given = list(found.parameters.values())
    if what == 'method' and given and given[0].name == 'self':
        del given[0]
    shown = [
        each.replace(annotation=_AsWritten(each.annotation))
        if isinstance(each.annotation, str)
        else each
        for each in given
        if not each.name.startswith('_')
    ]
    returned = found.return_annotation if what in ('function', 'method') else ''
    text = str(inspect.Signature(shown))
    return text, returned if isinstance(returned, str) else None


def setup(app: Sphinx):
    """Replace the signatures that autodoc found."""
    app.setup_extension('sphinx.ext.autodoc')
    app.connect('autodoc-process-signature', _signature)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
