# SPDX-License-Identifier: Apache-2.0
from io import StringIO
from math import nan

import pytest
from rich.console import Console

from kalman_ros.analysis.checks import Check
from kalman_ros.report.run_tables import checks_table

POLE = complex(-1.41, 1.71)
CHECKS = [
    Check('(b) Kalman: pole', '1/s', POLE, POLE, nan, nan, True),
    Check('(c) pole at -1.41-1.71j, off by', '', 0.0, 4.333e-9, -1e-3, 1e-3, True),
    Check('(a) change of the error', '', 0.0, 1.0, -1e-9, 1e-9, False),
]


@pytest.mark.parametrize('width', [64, 80, 200])
def test_however_narrow_the_terminal_every_verdict_is_seen(width):
    console = Console(width=width, file=StringIO())
    console.print(checks_table('', CHECKS))
    text = console.file.getvalue()
    assert 'ok' in text
    assert 'FAILS' in text
    assert '± 1e-09' in text
