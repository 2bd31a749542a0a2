# SPDX-License-Identifier: Apache-2.0
"""How Sphinx builds these pages: `./dev docs`, or rosdoc2 in a ROS installation."""

project = 'kalman_ros'
author = 'The kalman_ros authors'
extensions = ['myst_parser']
myst_heading_anchors = 3
exclude_patterns = ['_build', 'examples']
html_theme = 'alabaster'
html_theme_options = {'page_width': '60em', 'sidebar_width': '15em'}
html_extra_path: list[str] = []
