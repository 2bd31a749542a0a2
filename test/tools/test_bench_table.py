# SPDX-License-Identifier: Apache-2.0
"""The table of the benchmarks is whole on a terminal of 80 columns."""

from io import StringIO

from rich.console import Console
from tools.bench.program import Result, results_table


def test_no_number_is_cut_at_80_columns():
    results = [
        Result('a million steps of EKF and LQR, on a pole / 4 CPU s', 4.617, 4.0, 1.154, 1.0),
        Result('LQG run of 1000 steps, 1000 at once / filterpy', 4e-4, 0.0407, 0.0104, 0.005),
    ]
    console = Console(width=80, record=True, file=StringIO())
    console.print(results_table(results))
    printed = console.export_text()
    for number in ('4.62 s', '4.00 s', '1.154', '400 us', '41 ms', '0.010', '0.005'):
        assert number in printed
    assert '…' not in printed
    assert all(word in printed for word in ['a', 'million', 'steps', 'of', 'EKF', 'and', 'LQR'])
