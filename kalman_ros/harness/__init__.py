# SPDX-License-Identifier: Apache-2.0
"""Runs the real nodes without launch files and records their topics."""

from .launched_nodes import NodeError
from .run import Run

__all__ = ['NodeError', 'Run']
