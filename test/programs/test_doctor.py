"""The doctor from a bag to its verdict."""

import importlib
import json

import numpy as np
import pytest
from rich.console import Console

pytest.importorskip('rclpy')

from tools.strangers.injected.bag import write_bag
from tools.strangers.injected.recordings import Injection, recorded, values_of

from kalman_ros.analysis.checks import Check
from kalman_ros.analysis.diagnosis.diagnose import Diagnosis, diagnose
from kalman_ros.analysis.diagnosis.finding import Finding
from kalman_ros.bags.replay import replay
from kalman_ros.programs.doctor import program, tables
from kalman_ros.programs.doctor.loading import failed_checks, load
from kalman_ros.programs.replay.statistics import checks

pytestmark = pytest.mark.slow

SCENARIO = 'mass_spring_damper'
OFF = Finding('bias', 'gnss', 'it is off.', 9.0, same_as=2 * (('drift', 'gnss'),))
NEGATED = Injection(edits={'velocity': values_of(lambda y: -y)})


def run(*arguments):
    with pytest.raises(SystemExit) as ended:
        program.main([str(each) for each in arguments])
    return ended.value.code


def test_a_clean_bag_passes(tmp_path, capsys):
    write_bag(tmp_path / 'bag', SCENARIO, Injection(), 10.0, 3)
    assert run(tmp_path / 'bag', '--params-file', SCENARIO, '--out', tmp_path / 'out') == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith('PASS, 0 findings')


def test_a_bag_with_a_wrong_sign_fails_with_the_lines_to_change(tmp_path, capsys):
    write_bag(tmp_path / 'bag', SCENARIO, NEGATED, 10.0, 3)
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


def test_what_a_replay_fails_for_is_a_note_where_nothing_is_found(tmp_path, capsys, monkeypatch):
    write_bag(tmp_path / 'bag', SCENARIO, Injection(), 10.0, 3)
    bad = Check('NIS of position / 1', '', 1.0, 1.17, 0.846, 1.15, passed=False)
    monkeypatch.setattr(program, 'failed_checks', lambda _: [bad])
    arguments = tmp_path / 'bag', '--params-file', SCENARIO, '--out', tmp_path / 'out'
    assert run(*arguments) == 0
    *_, last = out = capsys.readouterr().out.splitlines()
    assert 'NIS of position / 1 is 1.17 (0.846 to 1.15).' in ' '.join(out)
    assert last.startswith('PASS, 0 findings: but a replay fails')
    monkeypatch.setattr(program, 'diagnose', lambda *_: Diagnosis((OFF,), (), 1.0, 0.0))
    assert run(*arguments) == 1
    assert 'a replay fails' not in capsys.readouterr().out


def test_a_parameter_is_changed_for_once(tmp_path, capsys):
    write_bag(tmp_path / 'bag', SCENARIO, Injection(), 10.0, 3)
    arguments = tmp_path / 'bag', '--params-file', SCENARIO, '--out', tmp_path / 'out'
    assert run(*arguments, '-p', 'model_parameters.mass:=3.0') == 1
    assert '3 is configured' in ' '.join(capsys.readouterr().out.split())
    assert run(*arguments, '-p', 'position.noise:=[-1.0]') == 2
    assert run(*arguments, '-p', 'position') == 2
    assert "expected NAME:=VALUE, got 'position'" in capsys.readouterr().err


def test_an_imu_on_its_side_is_seen_before_anything_else(tmp_path):
    def lying(y):
        return y[:, [0, 2, 1, 3, 5, 4]] * [1.0, 1.0, -1.0, 1.0, 1.0, -1.0]  # its y looks up

    side = Injection(edits={'imu': values_of(lying)})
    write_bag(tmp_path / 'bag', 'robot_3d', side, 8.0, 3)
    found = load(tmp_path / 'bag', 'robot_3d')
    assert np.argmax(found.forces['imu']) == 1
    first = diagnose(found, proofs=False).findings[0]
    assert (first.kind, first.subject) == ('rotated', 'imu')
    assert first.change['imu.mount.rotation'] == pytest.approx([np.pi / 2, 0.0, 0.0], abs=0.1)
    assert first.gain > 1000.0


def test_a_part_is_diagnosed_alone(tmp_path, capsys):
    half = Injection(
        edits={
            'velocity': values_of(lambda y: np.concatenate((y[: len(y) // 2], -y[len(y) // 2 :])))
        }
    )
    write_bag(tmp_path / 'bag', SCENARIO, half, 20.0, 3)
    arguments = tmp_path / 'bag', '--params-file', SCENARIO, '--out', tmp_path / 'out'
    assert run(*arguments, '--to', '9.9') == 0
    assert run(*arguments, '--from', '10.1') == 1
    assert 'first sign of velocity.v' in capsys.readouterr().out.splitlines()[-1]
    assert run(*arguments, '--from', '5', '--to', '4') == 2


def test_a_long_recording_has_a_first_answer_before_the_whole_is_examined(tmp_path, capsys):
    turned = Injection(edits={'joint_states': values_of(lambda y: y * [1.0, -1.0])})
    write_bag(tmp_path / 'bag', 'cart_pole', turned, 30.0, 3)
    arguments = tmp_path / 'bag', '--params-file', 'cart_pole', '--out', tmp_path / 'out'
    assert run(*arguments, '--to', '10') == 1
    assert 'At first sight' not in capsys.readouterr().out
    assert run(*arguments) == 1
    out = capsys.readouterr().out
    first, *_, last = out.splitlines()
    assert first.startswith('At first sight, from t = 0 to 8 s: sign of joint_states.theta')
    assert last.startswith('FAIL') and 'first sign of joint_states.theta' in last
    assert max(map(len, out.splitlines())) <= 80


def test_a_first_look_that_fails_leaves_the_whole(tmp_path, capsys, monkeypatch):
    def fails(evidence, *given, proofs=True):
        if not proofs:
            raise np.linalg.LinAlgError('singular')
        return diagnose(evidence, *given)

    monkeypatch.setattr(program, 'diagnose', fails)
    write_bag(tmp_path / 'bag', 'cart_pole', Injection(), 30.0, 3)
    arguments = tmp_path / 'bag', '--params-file', 'cart_pole', '--out', tmp_path / 'out'
    assert run(*arguments) == 0
    assert 'At first sight' not in capsys.readouterr().out


def test_the_checks_are_those_of_a_replay(tmp_path):
    write_bag(tmp_path / 'bag', SCENARIO, NEGATED, 10.0, 3)
    evidence = load(tmp_path / 'bag', SCENARIO)
    expected = [each.name for each in checks(replay(tmp_path / 'bag', SCENARIO), None)
                if not each.passed]  # fmt: skip
    assert expected and [each.name for each in failed_checks(evidence)] == expected


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


def test_what_fits_as_well_is_said_once():
    diagnosis = Diagnosis((OFF,), (), 1.0, 0.0)
    assert [*tables.sentences(diagnosis)] == [
        '1. It is off.', '   These data fit as well: drift of gnss.'
    ]  # fmt: skip
