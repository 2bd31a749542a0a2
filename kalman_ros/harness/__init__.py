# SPDX-License-Identifier: Apache-2.0
"""Start the real nodes without launch files, let them run, gather their topics, stop them."""

from .run import NodeError, Run

__all__ = ['NodeError', 'Run']
