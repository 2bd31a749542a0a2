# SPDX-License-Identifier: Apache-2.0
"""The error of a design that has no solution."""


class DesignError(ValueError):
    """The design has no solution; the message says why."""
