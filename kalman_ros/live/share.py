# SPDX-License-Identifier: Apache-2.0
"""What is on a live page as a parameter file."""

from __future__ import annotations

from kalman_ros.scenario.parameter_files import BETWEEN, NODES, sections
from kalman_ros.scenario.parameter_text import section_text

from .adjustments import Adjustments


def parameter_file(adjustments: Adjustments) -> str:
    """Return a parameter file that starts every node as it is now.

    What the file has for all nodes is under ``/**``, all else in the section of each node.
    """
    between = (BETWEEN,) if BETWEEN in sections(adjustments.file) else ()
    shared = adjustments.given('')
    head = f'# {adjustments.file.stem}, as it was on a live page.\n'
    parts = [head + section_text('/**', shared)]
    for node in (*NODES, *between):
        values = adjustments.given(node).items()
        own = {name: value for name, value in values if shared.get(name) != value}
        if own:
            parts.append(section_text(node, own))
    return '\n'.join(parts)
