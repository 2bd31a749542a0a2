"""The doctor from a bag to its verdict, and the page of its score."""

import importlib
import json
import pickle

import numpy as np
import pytest
from rich.console import Console

pytest.importorskip('rclpy')

from rclpy.serialization import serialize_message

from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.codecs.messages import full_type
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.programs.doctor import program, score, tables
from kalman_ros.programs.doctor.cases import cases, pairs
from kalman_ros.programs.doctor.recordings import Injection, recorded, simulated, values_of
from kalman_ros.programs.doctor.score_page import page
from kalman_ros.scenario import build, shipped
from kalman_ros.scenario.parameter_files import from_file
from kalman_ros.simulation.faults import FAULTS
from kalman_ros.simulation.faults.body import BodyOptions

pytestmark = pytest.mark.slow

SCENARIO = 'mass_spring_damper'
NEGATED = Injection(edits={'velocity': values_of(lambda y: -y)})


def write_bag(folder, injection, seconds=10.0):
    """Write a recording of the scenario as a bag, without a node."""
    readings, inputs = simulated(SCENARIO, injection, seconds, 3)
    scenario = build(from_file(shipped.file(SCENARIO), 'estimator'))
    rows = []
    with RecordingWriter(folder) as writer:
        for name, each in readings.items():
            source = scenario.sensors[name]
            R = source.sensor.covariance
            columns = zip(each.received, each.stamp, each.value)
            rows += [(source.signal, *row, R) for row in columns]
        rows += [(scenario.input, *row, None) for row in zip(*vars(inputs).values())]
        for signal in {id(row[0]): row[0] for row in rows}.values():
            writer.add(f'/{signal.topic}', full_type(signal.type))
        codecs = {row[0].topic: SignalCodec(row[0]) for row in rows}
        for signal, received, stamp, value, R in rows:
            message = codecs[signal.topic].encode(round(stamp * 1e9), value, R)
            data = bytes(serialize_message(message))
            writer.write(f'/{signal.topic}', round(received * 1e9), data)


def run(*arguments):
    with pytest.raises(SystemExit) as ended:
        program.main([str(each) for each in arguments])
    return ended.value.code


def test_a_clean_bag_passes(tmp_path, capsys):
    write_bag(tmp_path / 'bag', Injection())
    assert run(tmp_path / 'bag', '--params-file', SCENARIO, '--out', tmp_path / 'out') == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith('PASS, 0 findings')


def test_a_bag_with_a_wrong_sign_fails_with_the_lines_to_change(tmp_path, capsys):
    write_bag(tmp_path / 'bag', NEGATED)
    (tmp_path / 'out').mkdir()
    (tmp_path / 'out' / '02-bias.png').write_bytes(b'of an earlier diagnosis')
    assert run(tmp_path / 'bag', '--params-file', SCENARIO, '--out', tmp_path / 'out') == 1
    out = capsys.readouterr().out
    assert out.splitlines()[-1].startswith('FAIL, 1 finding: first sign of velocity.v')
    assert "velocity.kind: 'linear'" in out
    assert max(map(len, out.splitlines())) <= 80
    found = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    first = found['findings'][0]
    assert first['kind'] == 'sign'
    # the replay of the bag with these lines is the proof
    assert first['proof'] > 0.9 * first['gain'] > 100.0
    assert [path.name for path in (tmp_path / 'out').glob('*.png')] == ['01-sign.png']
    assert (tmp_path / 'out' / '01-sign.png').stat().st_size > 1000


def test_no_bag_is_one_line(tmp_path, capsys):
    assert run(tmp_path / 'none', '--out', tmp_path / 'out') == 2
    error = capsys.readouterr().err
    assert error.startswith('doctor: ')
    assert error.count('\n') == 1
    assert not (tmp_path / 'out').exists()


def test_a_name_that_a_terminal_would_obey_is_printed_as_text(tmp_path, capsys):
    assert run(tmp_path / 'a\x1b[31mb', '--out', tmp_path / 'out') == 2
    error = capsys.readouterr().err
    assert '\x1b' not in error
    assert 'a\\x1b[31mb' in error


@pytest.mark.parametrize('name', ['doctor', 'replay', 'allan'])
def test_a_program_that_is_interrupted_says_so_in_a_line(name, tmp_path, monkeypatch, capsys):
    def interrupted(*given, **named):
        raise KeyboardInterrupt

    interrupts = {'doctor': 'load', 'replay': 'replayed_with_progress', 'allan': 'Bag'}
    module = importlib.import_module(f'kalman_ros.programs.{name}.program')
    monkeypatch.setattr(module, interrupts[name], interrupted)
    (tmp_path / 'bag').mkdir()
    given = [str(tmp_path / 'bag'), '--out', str(tmp_path / 'out')]
    given += [] if name == 'allan' else ['--params-file', SCENARIO]
    with pytest.raises(SystemExit) as ended:
        module.main(given)
    assert ended.value.code == 130
    assert capsys.readouterr().err.strip() == f'{name}: interrupted'


def test_a_table_fits_a_terminal():
    found = diagnose(recorded(SCENARIO, NEGATED, 6.0, 1))
    console = Console(width=80, record=True, file=open('/dev/null', 'w'))  # noqa: SIM115
    console.print(tables.findings_table(found))
    assert '...' not in console.export_text()
    assert '…' not in console.export_text()


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
