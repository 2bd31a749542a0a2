# SPDX-License-Identifier: Apache-2.0
"""Fields that a result inherits, described on its page; what is not for users is left out."""

import inspect

from numpydoc.docscrape import NumpyDocString
from sphinx.application import Sphinx


def described(obj):
    """Return the entries of a class' Parameters, those of its bases last, by their names."""
    entries = {}
    for base in getattr(obj, '__mro__', (obj,)):
        if getattr(base, '__module__', '').startswith('kalman_ros') and base.__doc__:
            for entry in NumpyDocString(inspect.getdoc(base))['Parameters']:
                entries.setdefault(entry.name, entry)
    return entries


def _add_bases(app, what, name, obj, options, lines):
    if what != 'class' or not lines:
        return
    text = NumpyDocString('\n'.join(lines))
    own = {each.name for each in text['Parameters']}
    text['Parameters'] += [entry for key, entry in described(obj).items() if key not in own]
    if len(text['Parameters']) > len(own):
        lines[:] = str(text).splitlines()


def _skip(app, what, name, obj, skip, options):
    return True if name == 'other_names' else None


def setup(app: Sphinx):
    """Add them before numpydoc reads the text."""
    app.setup_extension('sphinx.ext.autodoc')
    app.connect('autodoc-process-docstring', _add_bases, priority=400)
    app.connect('autodoc-skip-member', _skip)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
