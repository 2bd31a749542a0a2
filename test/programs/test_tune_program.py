# SPDX-License-Identifier: Apache-2.0
"""`tune` from a bag to its verdict, and what it refuses."""

import importlib
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from rclpy.serialization import serialize_message
from simulated_recordings import readings, square_wave

from kalman_ros.analysis.tuning import ascent
from kalman_ros.analysis.tuning.likelihood import Likelihood
from kalman_ros.analysis.tuning.named_parameters import NamedParameters
from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.codecs.messages import full_type
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.programs.tune import program, recorded_likelihood, tables
from kalman_ros.programs.tune.recorded_likelihood import load
from kalman_ros.scenario import build
from kalman_ros.scenario.parameter_files import from_file

pytestmark = pytest.mark.slow

#: A spring that little disturbs, so that ten seconds determine it.
FILE = """/**:
  ros__parameters:
    model: mass_spring_damper
    model_parameters: {mass: 1.5, force_noise: 0.001}
    rate: 50.0
    sensors: [position]
    position: {noise: [0.03], rate: 25.0, covariance_from: configuration}
"""


@pytest.fixture(scope='module')
def recording(tmp_path_factory):
    """Return a bag of a spring of 1 kg, and the parameter file that believes in 1.5 kg."""
    folder = tmp_path_factory.mktemp('spring')
    file = folder / 'spring.yaml'
    file.write_text(FILE)
    values = {
        **from_file(file, 'estimator'),
        'model_parameters.mass': 1.0,
        'position.noise': [0.01],
    }
    time = np.arange(0.0, 16.0, 0.02)
    force = square_wave(time, 3.0, 5.0)[:, None]
    _, times, seen = readings(values, time, force, seed=1)
    scenario = build(values)
    source = scenario.sensors['position']
    rows = [(source.signal, t, y, source.sensor.covariance)
            for t, y in zip(times['position'], seen['position'])]  # fmt: skip
    rows += [(scenario.input, t, u, None) for t, u in zip(time, force)]
    rows.sort(key=lambda row: row[1])
    with RecordingWriter(folder / 'bag') as writer:
        codecs = {}
        for signal in (source.signal, scenario.input):
            writer.add(f'/{signal.topic}', full_type(signal.type))
            codecs[signal.topic] = SignalCodec(signal)
        for signal, t, values, R in rows:
            stamp = 10**9 + round(t * 1e9)
            data = bytes(serialize_message(codecs[signal.topic].encode(stamp, values, R)))
            writer.write(f'/{signal.topic}', stamp, data)
    return folder / 'bag', file


def run(*arguments):
    with pytest.raises(SystemExit) as ended:
        program.main([str(each) for each in arguments])
    return ended.value.code


def test_a_bag_is_fitted_judged_and_drawn(recording, tmp_path, capsys):
    bag, file = recording
    code = run(bag, '--params-file', file, '--fit', 'mass', 'position.noise', '--out', tmp_path)
    out = capsys.readouterr().out
    assert code == 0, out
    assert 'PASS, 2 of 2 parameters determined' in out
    fitted = from_file(tmp_path / 'fitted.yaml', 'estimator')
    assert fitted['model_parameters.mass'] == pytest.approx(1.0, rel=0.03)
    assert fitted['position.noise'] == pytest.approx([0.01], rel=0.2)
    found = json.loads((tmp_path / 'summary.json').read_text())
    assert found['log likelihood']['after'] > found['log likelihood']['before']
    assert found['held out']['after']['consistent']
    assert found['margins'][0]['plants'] > 10
    assert {path.name for path in tmp_path.glob('*.png')} == {'profiles.png', 'nis.png'}
    assert all(len(line) <= 80 for line in out.splitlines() if 'In /' not in line)


def test_a_part_is_fitted_alone(recording, tmp_path, capsys):
    bag, file = recording
    given = bag, file, {}, ['mass'], {}, {}, 0.0
    whole, half = (load(*given, part).likelihood for part in ((0.0, np.inf), (2.0, 10.0)))
    assert half.observations.count == pytest.approx(0.5 * whole.observations.count, abs=2)
    arguments = bag, '--params-file', file, '--fit', 'mass', 'position.noise', '--out', tmp_path
    assert run(*arguments, '--from', 2, '--to', 10) == 0
    assert 'PASS, 2 of 2 parameters determined' in capsys.readouterr().out
    assert run(*arguments, '--from', 10, '--to', 2) == 2


def test_gates_of_the_file_are_used_in_the_fit(recording):
    bag, file = recording
    gated = {'position.gate': 0.999, 'window': 0.0}
    likelihood = load(bag, file, gated, ['position.noise'], {}, {}, 0.0).likelihood
    limits = likelihood.conditions.policy.gates
    assert limits == {'position': pytest.approx(10.83, abs=0.01)}  # chi-square of one number
    assert not load(bag, file, {}, ['mass'], {}, {}, 0.0).likelihood.conditions.policy.gates


@pytest.mark.parametrize(('arguments', 'words'), [
    (['--fit', 'mss'], "did you mean 'mass'"),
    (['--fit', 'mass', '--bounds', 'mass=2..3'], 'exclude the start'),
    (['--bounds', 'mass=2-3'], '--bounds: expected NAME=LOW..HIGH'),
    (['--prior', 'mass=1.4'], '--prior: expected NAME=MEAN+-STD'),
    (['--bounds', 'mass=1..3', 'mass=1..4'], '--bounds: expected one of mass, got two'),
    (['--fit', 'mass', '--prior', 'mass=1+-1', 'model_parameters.mass=1+-2'],
     'priors: expected one of model_parameters.mass, got two'),
    (['--fit', 'mass', '--prior', 'mass=1.4+-0'], 'expected a prior of a mean and a standard'),
    (['--hold-out', '1'], '--hold-out'),
    (['-p', 'model_parameters.mass:=-1.0'], 'mass'),
])  # fmt: skip
def test_a_wrong_argument_is_refused_in_one_line(arguments, words, recording, tmp_path, capsys):
    bag, file = recording
    assert run(bag, '--params-file', file, '--out', tmp_path, *arguments) == 2
    error = capsys.readouterr().err
    assert words in error and error.count('\n') == 1 and error.startswith('tune: ')


def test_what_is_not_determined_is_marked_in_the_lines_to_paste(recording, tmp_path, capsys):
    bag, file = recording
    fit = '--fit', 'mass', 'position.noise', 'initial_std.x'
    assert run(bag, '--params-file', file, *fit, '--out', tmp_path) == 0
    assert 'initial_std.x: these data hardly depend on it.' in capsys.readouterr().out
    lines = (tmp_path / 'fitted.yaml').read_text().splitlines()
    mass, std = (next(line for line in lines if name in line) for name in ('mass', 'initial_std'))
    assert std.endswith('# not determined') and '#' not in mass


def test_a_fit_that_determines_nothing_fails_and_pastes_nothing(recording, tmp_path, capsys):
    bag, file = recording
    given = '--fit', 'initial_std.x', '-p', 'position.noise:=[0.01]', '--out', tmp_path
    assert run(bag, '--params-file', file, '-p', 'model_parameters.mass:=1.0', *given) == 1
    out = capsys.readouterr().out
    assert 'FAIL, 0 of 1 parameters determined' in out and 'For the parameter file' not in out
    assert not (tmp_path / 'fitted.yaml').read_text()


@pytest.mark.thorough
def test_a_prior_that_is_sure_holds_a_parameter(recording, tmp_path):
    bag, file = recording
    given = '--fit', 'mass', 'position.noise', '--prior', 'mass=1.4+-0.0001', '--out', tmp_path
    run(bag, '--params-file', file, *given)
    fitted = from_file(tmp_path / 'fitted.yaml', 'estimator')
    assert fitted['model_parameters.mass'] == pytest.approx(1.4, abs=2e-3)


def test_a_bag_that_is_missing_is_refused(tmp_path, capsys):
    assert run(tmp_path / 'none', '--params-file', 'mass_spring_damper', '--out', tmp_path) == 2
    assert capsys.readouterr().err.startswith('tune: ')


def interrupted_at(monkeypatch, count):
    """Interrupt the fit at one of its expansions of the likelihood."""
    expand_all, calls = Likelihood.expand_all, []

    def interrupted(self, points, progress=None):
        calls.append(points)
        if len(calls) == count:
            raise KeyboardInterrupt
        return expand_all(self, points, progress)

    monkeypatch.setattr(Likelihood, 'expand_all', interrupted)


def test_an_interrupted_fit_keeps_what_it_reached(recording, tmp_path, capsys, monkeypatch):
    bag, file = recording
    interrupted_at(monkeypatch, 4)
    given = '--params-file', file, '--fit', 'mass', 'position.noise', '--out', tmp_path
    code = run(bag, *given)
    out = ' '.join(capsys.readouterr().out.split())
    assert code == 130
    assert 'FAIL, 2 of 2 parameters determined: interrupted' in out
    assert 'Not converged, interrupted: these values, which have no intervals' in out
    found = json.loads((tmp_path / 'summary.json').read_text())
    assert found['interrupted'] and not found['converged'] and found['held out'] is None
    assert found['log likelihood']['after'] > found['log likelihood']['before']
    assert (tmp_path / 'fitted.yaml').read_text().startswith('# interrupted\n')
    mass = from_file(tmp_path / 'fitted.yaml', 'estimator')['model_parameters.mass']
    assert mass == found['change']['model_parameters.mass'] != 1.5
    assert not list(tmp_path.glob('*.png'))


def test_an_interruption_before_anything_was_reached_goes_on(recording, tmp_path, monkeypatch):
    bag, file = recording
    interrupted_at(monkeypatch, 1)
    with pytest.raises(KeyboardInterrupt):
        program.main([str(bag), '--params-file', str(file), '--out', str(tmp_path)])


def test_an_interruption_after_the_fit_keeps_it(recording, tmp_path, capsys, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(program, 'profiles', interrupted)
    bag, file = recording
    assert run(bag, '--params-file', file, '--fit', 'mass', '--out', tmp_path) == 130
    assert 'interrupted' in capsys.readouterr().out
    fitted = from_file(tmp_path / 'fitted.yaml', 'estimator')
    assert fitted['model_parameters.mass'] == pytest.approx(1.0, rel=0.05)


@pytest.mark.thorough
def test_a_fit_that_does_not_converge_keeps_what_it_reached(
    recording, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(ascent, '_MOST_STEPS', 1)
    bag, file = recording
    code = run(bag, '--params-file', file, '--fit', 'mass', 'position.noise', '--out', tmp_path)
    out = ' '.join(capsys.readouterr().out.split())
    assert code == 1
    assert 'Not converged, 1 steps from a start are not enough: these values, which have no' in out
    assert out.endswith('not converged, 1 steps from a start are not enough')
    assert 'model_parameters.mass' in (tmp_path / 'fitted.yaml').read_text()


@pytest.mark.parametrize(
    ('density', 'positive'), [([0.2, 0.1], {'0', '1'}), ([0.2, -0.01, -0.01, 0.1], {'0', '3'})]
)
def test_the_variances_of_a_density_stay_positive(density, positive):
    """The plants within the intervals of a fit are possible ones, then."""
    named = NamedParameters({'model': 'linear', 'model_parameters.noise_density': density})
    chosen = named.choose(['model_parameters.noise_density'])
    assert {each.name.rpartition('.')[2] for each in chosen if each.positive} == positive


def test_variances_of_zero_stay_so_with_their_list():
    named = NamedParameters({'model': 'linear', 'model_parameters.noise_density': [0.0, 0.1]})
    (free,) = named.choose(['noise_density'])
    assert free.name == 'model_parameters.noise_density.1'
    with pytest.raises(ValueError, match='it is 0; give it a start above 0'):
        named.choose(['model_parameters.noise_density.0'])


def test_readings_that_are_all_the_same_have_no_noise_to_fit():
    """Such as the velocities to the side and upwards in the odometry of a robot on wheels."""
    named = NamedParameters({'model': 'diff_drive'})
    output = named.scenario.sensors['odometry'].sensor.output
    assert output.names == ('v', 'omega')
    value = np.array([[0.0, 0.1], [0.0, 0.2], [np.nan, 0.3]])
    sensors = {'odometry': SimpleNamespace(value=value)}
    replayed = SimpleNamespace(sensors=sensors, scenario=named.scenario)
    constant = list(recorded_likelihood._constant(replayed))
    assert constant == ['odometry.noise.v']
    source = named.scenario.sensors['odometry']
    known = replace(source, signal=replace(source.signal, zero=True))
    intended = SimpleNamespace(
        sensors=sensors, scenario=SimpleNamespace(sensors={'odometry': known})
    )
    assert list(recorded_likelihood._constant(intended)) == []
    left = recorded_likelihood._changing(named, ['odometry.noise'], constant)
    assert left == ['odometry.noise.omega']
    assert 'odometry.noise.v' not in recorded_likelihood._changing(named, [], constant)
    both = [*constant, 'odometry.noise.omega']
    for names in (constant, ['odometry.noise']):
        with pytest.raises(ValueError, match='All readings of odometry.v are the same'):
            recorded_likelihood._changing(named, names, both)


def test_a_fitted_delay_becomes_an_offset_of_the_stamps():
    """The offset of the file is its start; the stamps of the recording are corrected by it."""
    named = NamedParameters({'model': 'constant_velocity', 'lidar.stamp_offset': -0.02})
    (delay,) = named.choose(['lidar.delay'])
    assert delay.start == pytest.approx(0.02)
    assert named.changes({'lidar.delay': 0.07}) == {'lidar.stamp_offset': pytest.approx(-0.07)}
    assert named.candidate({'lidar.delay': 0.07}).delays == {'lidar': pytest.approx(0.05)}
    assert not [name for name in named.names if 'stamp_offset' in name]
    assert named.parameter('lidar.delay') == 'lidar.stamp_offset'


def test_a_fitted_bias_is_said_with_what_follows_it():
    fitted = SimpleNamespace(determined=True, name='beacon.bias', value=0.58, unit='m')
    unknown = SimpleNamespace(determined=False, name='gyro.bias', value=0.1, unit='rad/s')
    other = SimpleNamespace(determined=True, name='bias_noise', value=0.1, unit='')
    (sentence,) = tables.beside(SimpleNamespace(parameters=[fitted, unknown, other]))
    assert sentence.startswith('beacon.bias: readings are too large by 0.58 m; ')
    assert sentence.endswith('let the estimator follow it (beacon.bias_std).')


def test_a_robot_that_follows_motions_has_no_margins():
    file = Path(__file__).parents[2] / 'docs' / 'examples' / 'robot_on_a_path.yaml'
    named = SimpleNamespace(scenario=build(from_file(file, 'estimator')), changes=lambda _: {})
    recorded, fitted = SimpleNamespace(named=named), SimpleNamespace(values={})
    margins, why = program._margins(file, {}, recorded, fitted)
    assert not margins and why.startswith('No margins: at rest no input moves all of its states')


@pytest.mark.parametrize('program', ['replay.program', 'doctor.program', 'tune.program', 'record'])
def test_a_second_parameter_file_is_refused(program, capsys):
    """The last one counted, without a word."""
    arguments = importlib.import_module(f'kalman_ros.programs.{program}').arguments
    rest = ['--out', 'out'] if program == 'record' else ['bag']
    given = ['--params-file', 'one.yaml', *rest]
    assert str(arguments(given).params_file) == 'one.yaml'
    with pytest.raises(SystemExit):
        arguments([*given, '--params-file', 'two.yaml'])
    assert '--params-file: expected one, got two' in capsys.readouterr().err
