# SPDX-License-Identifier: Apache-2.0
"""Formulas of the pages as MathML, which browsers set themselves: no script, and no network."""

import re

import latex2mathml.converter
from docutils import nodes
from sphinx.application import Sphinx


def _inline(self, node):
    self.body.append(_set(node.astext(), 'inline'))
    raise nodes.SkipNode


def _block(self, node):
    self.body.append(f'<div class="formula">{_set(node.astext(), "block")}</div>\n')
    raise nodes.SkipNode


def _set(formula, display):
    # the converter knows the rows that TeX calls aligned by another name
    rows = formula.replace('{aligned}', '{align*}')
    found = latex2mathml.converter.convert(rows, display=display)
    # what is not understood would be shown as it is typed
    left = re.search(r'<m[io]>(\\\w+|&)<', found)
    if left:
        raise ValueError(f'{left[1]} in {formula}')
    return found


def setup(app: Sphinx):
    """Set formulas in HTML pages, as the extensions of Sphinx do that load a script."""
    app.add_html_math_renderer('mathml', (_inline, None), (_block, None))
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
