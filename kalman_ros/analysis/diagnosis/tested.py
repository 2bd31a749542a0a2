# SPDX-License-Identifier: Apache-2.0
"""Corrections that are compared by filter passes, where no linearisation says which is right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .examination import Examination
from .finding import Finding
from .passage import explained


def tested(case: Examination, finding: Finding) -> tuple[float, Finding]:
    """Return what the correction of a finding explains, and the finding with its pass.

    It explains less than nothing if the filter fails with it.
    """
    assert finding.mended is not None
    try:
        after = Examination(finding.mended()).passage
    except np.linalg.LinAlgError:
        return -np.inf, finding
    return explained(case.passage, after), replace(finding, passage=after)


def likelier(case: Examination, *findings: Finding) -> Finding:
    """Return the finding whose correction explains most."""
    return max((tested(case, finding) for finding in findings), key=lambda outcome: outcome[0])[1]
