# SPDX-License-Identifier: Apache-2.0
"""How Sphinx builds these pages: `./dev docs`, or rosdoc2 in a ROS installation."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]

project = 'kalman_ros'
author = 'The kalman_ros authors'
extensions = [
    'back_links',
    'explorables',
    'inherited_fields',
    'mathml',
    'parameter_entries',
    'signatures',
    'myst_parser',
    'numpydoc',
    'sphinx.ext.autodoc',
    'sphinx.ext.autosummary',
    'sphinx.ext.viewcode',
    'sphinx_copybutton',
]
myst_heading_anchors = 3
myst_enable_extensions = ['dollarmath']
exclude_patterns = ['_build', 'examples']
templates_path = ['_templates']
# `signatures` has the types
autodoc_typehints = 'none'
autodoc_member_order = 'bysource'
python_maximum_signature_line_length = 70
numpydoc_show_class_members = False
html_math_renderer = 'mathml'
smartquotes = False  # in quotes there is mostly code
html_theme = 'furo'
html_show_copyright = False
html_title = 'kalman_ros'
html_static_path = ['_static']
html_css_files = ['pages.css']
copybutton_prompt_text = '$ '
