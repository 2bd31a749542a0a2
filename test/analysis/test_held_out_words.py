# SPDX-License-Identifier: Apache-2.0
"""A fit is judged by readings held out only if there are enough of a sensor."""

from types import SimpleNamespace

import numpy as np
import pytest

from kalman_ros.analysis.tuning.held_out import Judgement, SensorJudgement
from kalman_ros.programs.tune.tables import verdict


@pytest.mark.parametrize('enough', [False, True])
def test_too_few_readings_are_not_called_as_they_should_be(enough, monkeypatch):
    monkeypatch.setattr('kalman_ros.analysis.tuning.held_out._LEAST', 3)
    squares = np.ones(3 if enough else 2)
    sensor = SensorJudgement(squares, squares, 1.0, (0.5, 2.0), 0.0, 0.5, 0)
    held = Judgement(1.0, len(squares), {'y': sensor})
    fit = SimpleNamespace(parameters=[SimpleNamespace(determined=True)], converged=True)
    passed, words = verdict(fit, (held, held))
    assert passed and held.consistent and held.judged is enough
    assert ('as they should be' in words) is enough
    assert ('too few of any sensor to judge NIS' in words) is not enough
