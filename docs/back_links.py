# SPDX-License-Identifier: Apache-2.0
"""Links from the source of an object to its page, where the page has another name for it."""

import re
from pathlib import Path

from sphinx.application import Sphinx

_LINK = re.compile(r'(href="([^"#]+))#([^"]+)(?="[^>]*>\[docs\])')


def _mend(app, error):
    """Let links that lead to no place of their page lead to its beginning."""
    places = {}

    def mended(file, found):
        page = (file.parent / found[2]).resolve()
        if page not in places:
            places[page] = set(re.findall(r'id="([^"]+)"', page.read_text()))
        return found[0] if found[3] in places[page] else found[1]

    for file in Path(app.outdir, '_modules').rglob('*.html') if error is None else ():
        file.write_text(_LINK.sub(lambda found, file=file: mended(file, found), file.read_text()))


def setup(app: Sphinx):
    """Mend the links once all pages are written."""
    app.connect('build-finished', _mend)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
