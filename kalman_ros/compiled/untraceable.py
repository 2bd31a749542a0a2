# SPDX-License-Identifier: Apache-2.0
"""The exception of functions whose formulas cannot be recorded."""

from __future__ import annotations


class UntraceableError(BaseException):
    """A function whose formulas cannot be recorded, with the reason.

    Not an `Exception`, which a function may catch to go on with other formulas.
    """
