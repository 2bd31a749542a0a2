# SPDX-License-Identifier: Apache-2.0
"""The parameter file that the doctor proposes for a recording."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from rclpy.serialization import serialize_message
from std_msgs.msg import String

from kalman_ros.bags.reading import Bag
from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.bags.replay import estimator_settings
from kalman_ros.codecs.messages import full_type
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.core import Space
from kalman_ros.programs.doctor import program
from kalman_ros.programs.doctor.proposal import propose, scatter
from kalman_ros.scenario.parameter_files import from_file

START = 1_700_000_000_000_000_000


def write(folder, scenario, renamed, rate=50.0, noise=0.2, seconds=20.0):
    """Write readings of a body that swings, with every sensor of a scenario at one rate."""
    rng = np.random.default_rng(4)
    with RecordingWriter(folder) as writer:
        for name, source in estimator_settings(scenario).scenario.sensors.items():
            topic, codec = renamed[name], SignalCodec(source.signal)
            writer.add(topic, full_type(source.signal.type))
            k = source.sensor.output.size
            for step in range(round(seconds * rate)):
                t = round(START + step / rate * 1e9)
                y = np.sin(step / rate) + noise * rng.normal(size=k)
                writer.write(topic, t, bytes(serialize_message(codec.encode(t, y, None))))


def run(*arguments):
    with pytest.raises(SystemExit) as ended:
        program.main([str(each) for each in arguments])
    return ended.value.code


@pytest.mark.thorough
@pytest.mark.slow
def test_other_names_and_rates_are_found_and_noise_is_measured(tmp_path, capsys):
    renamed = {'position': '/robot/gps_position', 'velocity': '/velocity'}
    write(tmp_path / 'bag', 'mass_spring_damper_2d', renamed)
    best = propose(Bag(tmp_path / 'bag'))[0]
    assert best.scenario == 'mass_spring_damper_2d' and best.input == '' and best.share == 1.0
    assert best.matches['position'].topic == 'robot/gps_position'
    for match in best.matches.values():
        assert match.rate == pytest.approx(50.0, rel=1e-3)
        # the median of 1000 correlated differences: three standard deviations are 12 %
        np.testing.assert_allclose(match.noise, 0.2, rtol=0.12)
    assert run(tmp_path / 'bag', '--out', tmp_path / 'out') == 0
    said = capsys.readouterr().out
    assert 'PoseWithCovarianceStamped' in said and 'gap (s)' in said
    assert max(map(len, said.replace(str(tmp_path), '').splitlines())) <= 80
    values = from_file(tmp_path / 'out' / 'proposal.yaml', 'estimator')
    found = estimator_settings(values)
    assert found.options.initialize == 'reading'
    assert found.scenario.sensors['position'].signal.topic == 'robot/gps_position'
    # not of this robot, but readings arrive
    assert run(tmp_path / 'bag', '--params-file', tmp_path / 'out' / 'proposal.yaml') in (0, 1)
    assert 'No reading' not in capsys.readouterr().out


@pytest.mark.slow
def test_a_sensor_without_a_topic_is_disabled(tmp_path):
    write(tmp_path / 'bag', 'mass_spring_damper_2d', {'position': '/position', 'velocity': '/v'})
    one = Bag(tmp_path / 'bag')
    del one.topics['/v']
    best = next(each for each in propose(one) if each.scenario == 'mass_spring_damper_2d')
    assert best.share == 0.5
    values = best.parameters()
    assert values['position.enabled'] and not values['velocity.enabled']
    assert [*estimator_settings(values).scenario.enabled] == ['position']


def test_a_recording_that_fits_nothing_is_described(tmp_path, capsys):
    with RecordingWriter(tmp_path / 'bag') as writer:
        writer.add('/words', 'std_msgs/msg/String')
        for step in range(50):
            writer.write('/words', START + step, bytes(serialize_message(String(data='word'))))
    assert run(tmp_path / 'bag', '--out', tmp_path / 'out') == 2
    said = capsys.readouterr().out
    assert '/words' in said and 'own_robot.md' in said


def test_the_scatter_is_that_of_the_noise_not_of_the_signal_its_jumps_or_its_outliers():
    rng, t = np.random.default_rng(0), np.arange(5000) * 0.01
    space = Space(('a', 'angle'), ('', 'rad'), angles=('angle',))
    signal = np.column_stack((np.sin(3.0 * t) + (t > 20.0) * 5.0, 2.0 * t))
    y = signal + rng.normal(size=signal.shape) * [0.1, 0.02]
    y[::50, 0] += 100.0
    np.testing.assert_allclose(scatter(space, space.wrap(y)), [0.1, 0.02], rtol=0.1)
    assert not scatter(space, np.zeros((100, 2))).any()
