# SPDX-License-Identifier: Apache-2.0
"""Start the real nodes without launch files, let them run, gather their topics, stop them."""

from .launched_nodes import NodeError
from .run import Run

__all__ = ['NodeError', 'Run']
