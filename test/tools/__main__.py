# SPDX-License-Identifier: Apache-2.0
"""Runs a tool that measures the package: ``python -m tools NAME``, or ``./dev NAME``."""

import sys

from kalman_ros import entry

name = sys.argv.pop(1)
entry.run(name, f'tools.{name}.program')
