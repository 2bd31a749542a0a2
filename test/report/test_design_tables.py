# SPDX-License-Identifier: Apache-2.0
"""What `design` prints at 80 columns: whole numbers, whole lines."""

import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from scipy.linalg import expm
from thorough import mostly_thorough

from kalman_ros import scenario
from kalman_ros.analysis.design_theory import report
from kalman_ros.analysis.design_warnings import notes, warnings
from kalman_ros.report.design_tables import closing, matrices, structure, tables
from kalman_ros.report.sheet import Sheet
from kalman_ros.scenario.parameter_files import from_file

CONFIG = Path(__file__).parents[2] / 'config'
NAMES = sorted(path.stem for path in CONFIG.glob('*.yaml'))


def printed(sheets, width=80):
    console = Console(file=io.StringIO(), width=width, highlight=False)
    for title, sheet in sheets:
        console.print(title)
        console.print(*sheet.tables(console), sep='\n\n')
    return console.file.getvalue()


def plain(cell):
    return cell.replace('\\[', '[').replace('[bold red]', '').replace('[/]', '')


@pytest.mark.slow
@pytest.mark.parametrize('name', mostly_thorough(NAMES, 'cart_pole', 'robot_3d'))
def test_nothing_is_cut_at_80_columns(name):
    path = CONFIG / f'{name}.yaml'
    built = scenario.build(from_file(path, 'estimator', 'controller'))
    found = report(built, duration=min(4.0, 400.0 / built.rate))
    sheets = [*tables(found), *matrices(found)]
    text = printed(sheets)
    assert max(map(len, text.splitlines())) <= 80 and '…' not in text
    words = text.split()
    for _, sheet in sheets:
        for _, cells in sheet.columns:
            assert len(cells) == len(sheet.names)
            for cell in cells:
                assert all(word in words for word in plain(cell).split()), cell
    said = [structure(found), *closing(found), *notes(found), *warnings(found, 1.0 / built.rate)]
    assert not any('bear' in sentence.replace('bearing', '') for sentence in said)


def test_matrices_are_those_of_the_system():
    """m dv/dt = -c v - k x + u, sampled, with dlqr's K and the Joseph form's P = (I - L C) P_p."""
    values = {
        'model': 'mass_spring_damper', 'rate': 50.0,
        'model_parameters.mass': 2.0, 'model_parameters.stiffness': 8.0,
        'model_parameters.damping': 3.0, 'model_parameters.force_noise': 0.5,
        'sensors': ['position'], 'position.noise': [0.2], 'position.rate': 50.0,
    }  # fmt: skip
    built = scenario.build(values)
    M = {
        title.split()[0].rstrip(','): np.array([cells for _, cells in sheet.columns], float).T
        for title, sheet in matrices(report(built, duration=2.0))
    }
    np.testing.assert_allclose(M['A'], [[0.0, 1.0], [-4.0, -1.5]])
    np.testing.assert_allclose(M['B'], [[0.0], [0.5]])
    np.testing.assert_allclose(M['C'], [[1.0, 0.0]])
    np.testing.assert_allclose(M['R'], [[0.04]])
    np.testing.assert_allclose(M['F'], expm(0.02 * M['A']), atol=2e-4)
    F, G, C, P, K, L = (M[name] for name in 'FGCPKL')
    assert np.abs(np.linalg.eigvals(F - G @ K)).max() < 1.0
    np.testing.assert_allclose(L, P @ C.T / 0.04, rtol=2e-3)  # K = P H' R^-1
    prior = F @ P @ F.T + M['Q']
    np.testing.assert_allclose(P, (np.eye(2) - L @ C) @ prior, rtol=2e-2)


def test_a_wide_sheet_is_continued_below():
    names = ['first', 'second']
    sheet = Sheet(names, [(f'column {k}', ['-1.234e+05', '5']) for k in range(20)])
    text = printed([('Wide', sheet)], 60)
    assert max(map(len, text.splitlines())) <= 60
    assert text.count('-1.234e+05') == 20 and text.count('first') > 1
    long = Sheet(['x' * 70], [('value', ['-1.234e+05'])])
    assert '-1.234e+05' in printed([('Long', long)], 40)


def test_margins_are_said_to_hold_where_no_predicted_limit_acts():
    said = [
        ' '.join(notes(report(scenario.build({'model': 'mass_spring_damper', 'law': law}))))
        for law in ('lqr', 'mpc')
    ]
    assert 'Limits are predicted 2 s ahead. Margins and the least cost hold' in said[1]
    assert 'Limits are predicted' not in said[0]
