# SPDX-License-Identifier: Apache-2.0
"""Pictures with handles in the pages: a directive, and the script that draws them, as one file."""

from __future__ import annotations

from pathlib import Path

from bundle import EXPLORE, bundle, palette
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


class Explorable(SphinxDirective):
    """``{explorable} NAME``: the place of a picture with handles; its text is for other media."""

    required_arguments = 1
    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the place, with the text that stands there until the script runs."""
        name = self.arguments[0]
        if not (EXPLORE / f'{name}.js').is_file():
            raise self.error(f'there is no explorable {name}')
        self.env.metadata[self.env.docname]['explorables'] = 'yes'
        section = nodes.container(classes=['explorable'], ids=[f'explore-{name}'])
        section += self.parse_content_to_nodes()
        return [section]


def _add_script(app: Sphinx, page: str, template, context, doctree) -> None:
    if app.env.metadata.get(page, {}).get('explorables'):
        app.add_js_file('explorables.js', loading_method='defer')
        app.add_css_file('explorables.css')


def _write(app: Sphinx, failed: Exception | None) -> None:
    if failed is None and app.builder.format == 'html':
        static = Path(app.outdir) / '_static'
        (static / 'explorables.js').write_text(bundle(EXPLORE / 'index.js'))
        (static / 'explorables.css').write_text(palette())


def setup(app: Sphinx):
    """Add the directive, and the script to the pages that have one."""
    app.add_directive('explorable', Explorable)
    app.connect('html-page-context', _add_script)
    app.connect('build-finished', _write)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
