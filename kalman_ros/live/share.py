# SPDX-License-Identifier: Apache-2.0
"""Parameter file of the current parameters of a live page."""

from __future__ import annotations

from kalman_ros.scenario.parameter_files import BETWEEN, NODES, sections
from kalman_ros.scenario.parameter_text import section_text

from .adjustments import Adjustments


def parameter_file(adjustments: Adjustments) -> str:
    """Return the text of a parameter file that starts every node with its current parameters.

    Parameters of all nodes are in the section ``/**``, other values in the section of each node.
    """
    between = (BETWEEN,) if BETWEEN in sections(adjustments.file) else ()
    shared = adjustments.given('')
    head = f'# {adjustments.file.stem}, as it was on a live page.\n'
    parts = [head + section_text('/**', shared)]
    for node in (*NODES, *between):
        values = adjustments.given(node).items()
        changed = {name: value for name, value in values if shared.get(name) != value}
        if changed:
            parts.append(section_text(node, changed))
    return '\n'.join(parts)
