# SPDX-License-Identifier: Apache-2.0
"""Each study alone, at a reduced size, on the real nodes."""

import pytest
from thorough import mostly_thorough

pytest.importorskip('rclpy')

from importlib import import_module

from kalman_ros.programs import study
from kalman_ros.programs.study.program import claim


@pytest.mark.parametrize('name', mostly_thorough(study.STUDIES, 'sampling', 'stability'))
def test_theory_and_measurement_agree(name, tmp_path):
    findings = import_module(f'{study.__name__}.{name}').study(0.3)
    assert findings.checks
    assert [check.name for check in findings.checks if not check.passed] == []
    findings.draw(tmp_path / 'picture.png')
    assert (tmp_path / 'picture.png').stat().st_size > 5000
    assert claim(name).endswith('.')
