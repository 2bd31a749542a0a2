# SPDX-License-Identifier: Apache-2.0
"""The operations of a step, which the source counts as C++, are those of the formulas."""

import shutil

import pytest

import kalman_ros as kr
from kalman_ros.compiled.library import compiler

pytest.importorskip('casadi')

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not (compiler() and shutil.which('c++')), reason='there is no compiler of C and C++'
    ),
]


def operations(folder, filter='kf', **options):
    """Return the count of a random walk with one reading, as written to a folder."""
    model = kr.continuous_model([[0.0]], W=[0.1])
    scenario = kr.make_scenario(
        model, ([[1.0]], [[0.5]]), rate=10.0, initial=([0.0], [[1.0]]), filter=filter
    )
    found = kr.export(scenario, folder, **options)
    return found.built.operations


def test_a_scalar_filter_takes_some_dozens(tmp_path):
    """F P F + Q, S = P + R, K = P / S, (1 - K) P (1 - K) + K R K, the rest is checks."""
    both = [operations(tmp_path / each, precision=each) for each in ('float64', 'float32')]
    assert 20 < min(both) <= max(both) < 80


def test_without_cpp_the_row_is_left_out(tmp_path, monkeypatch):
    which = shutil.which
    monkeypatch.setattr(
        shutil, 'which', lambda name, *more: None if '+' in name else which(name, *more)
    )
    assert operations(tmp_path / 'c') is None


@pytest.mark.thorough
def test_a_fixed_gain_takes_fewer(tmp_path):
    fewer = operations(tmp_path / 'fixed', 'steady_state')
    assert fewer < operations(tmp_path / 'kf')
