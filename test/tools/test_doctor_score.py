"""The score of the diagnosis on faults that are injected, and its page."""

import json
import pickle

import numpy as np
import pytest
from tools.doctor_score import program as score
from tools.doctor_score.cases import cases, pairs
from tools.doctor_score.page import page

from kalman_ros.simulation.faults import FAULTS
from kalman_ros.simulation.faults.body import BodyOptions

pytestmark = pytest.mark.slow


def test_every_fault_of_the_injector_is_scored():
    injected = {case.fault for case in cases()}
    options = {next(iter(kind.__dataclass_fields__)) for kind in FAULTS}
    assert options <= injected
    assert {'actuator_loss', 'actuator_dead_zone', 'disturbance_constant'} <= injected
    assert {'disturbance_noise'} <= set(BodyOptions.__dataclass_fields__) & injected
    assert {'unit', 'sign', 'swap', 'rotation', 'clock_offset', 'unrelated'} <= injected
    assert {'input_gain', 'input_sign'} <= injected
    assert len(injected) >= 20
    assert all(one.scenario == two.scenario for one, two in pairs())


def test_a_row_of_the_score():
    case = next(case for case in cases() if case.fault == 'dropout')
    row = score.row('dropout', [case], 6.0, 1)
    assert row.ranks == [1]
    assert row.found[0] == 'losses of position'


def test_the_page_counts():
    def made(fault, ranks, found=(), tied=False):
        return score.Row(fault, 'level', ranks, tied, list(found), 1.5)

    rows = [
        made('bias', [1]), made('bias', [2]), made('sign', [1], tied=True), made('nan', [0]),
        made('bias and nan', [1, 3]), made('none', []), made('none', [], ['bias of x']),
    ]  # fmt: skip
    text = page(rows, 60.0, 1)
    assert '| kinds of faults | 3 |' in text
    assert '| the right cause first in every scenario | 1 |' in text
    assert '| the right cause among the first three in every scenario | 2 |' in text
    assert '| with the right cause first | 2 |' in text
    assert '| pairs with both among the first four | 1 of 1 |' in text
    assert '| clean recordings with a finding | 1 of 2 |' in text
    assert '| nan | level | - | nothing |' in text


def test_other_processes_can_score_every_recording():
    planned = score.work(score.arguments([]))
    assert len(pickle.loads(pickle.dumps(planned))) == len(cases()) + len(pairs()) + 100


def test_a_score_is_resumed(tmp_path):
    options = score.arguments(['--resume'])
    file = tmp_path / 'rows.jsonl'
    entry = {'key': 'a', **vars(score.Row('bias', 'level', [1], False, [], 1.0))}
    file.write_text(json.dumps(entry) + '\n')
    (row,) = score.scored([('bias', 'a', score.row, ())], file, options)
    assert row.ranks == [1]
    assert np.isfinite(row.seconds)
