# SPDX-License-Identifier: Apache-2.0
"""Where these tools are, for other processes."""

import os
from collections.abc import Mapping
from pathlib import Path


def with_tools(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return an environment in which ``python -m tools`` is known."""
    known = str(Path(__file__).parents[1]), environment.get('PYTHONPATH', '')
    return {**environment, 'PYTHONPATH': os.pathsep.join(filter(None, known))}
