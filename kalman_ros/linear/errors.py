# SPDX-License-Identifier: Apache-2.0
"""What is raised when something that was asked for cannot be built."""


class DesignError(ValueError):
    """The design has no solution; the message says why."""
