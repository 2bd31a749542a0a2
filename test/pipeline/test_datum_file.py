# SPDX-License-Identifier: Apache-2.0
"""A datum in a file: kept over restarts, or refused in one line."""

import os

import pytest

pytest.importorskip('rclpy')

from kalman_ros.bags.replay import estimator_settings
from kalman_ros.core.geodesy import Place
from kalman_ros.pipeline.datum_file import read_datum, write_datum

DATUM = Place(49.8728, 8.6512, 144.0)


def test_a_datum_comes_back_to_a_tenth_of_a_millimetre(tmp_path):
    file = tmp_path / 'datum.yaml'
    assert read_datum(str(file)) is None
    write_datum(str(file), Place(-33.123456789123, 151.987654321987, -12.34567))
    found = read_datum(str(file))
    assert found.latitude == pytest.approx(-33.123456789123, abs=1e-9)
    assert found.longitude == pytest.approx(151.987654321987, abs=1e-9)
    assert found.altitude == pytest.approx(-12.34567, abs=1e-4)
    assert [path.name for path in tmp_path.iterdir()] == ['datum.yaml']


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        ('', 'no section is for one of'),
        ('- 1\n', 'not a ROS parameter file'),
        ('[{', 'not YAML'),
        ('/**: {ros__parameters: {datum: here}}', "expected a datum, got 'here'"),
        ('/**: {ros__parameters: {datum: [1, 2, x]}}', 'expected a datum'),
        ('/**: {ros__parameters: {datum: [1, 2]}}', 'got 2 numbers'),
        ('/**: {ros__parameters: {datum: [95, 2, 0]}}', 'latitude'),
    ],
)
def test_another_file_is_refused_in_one_line_that_names_it(tmp_path, text, why):
    file = tmp_path / 'datum.yaml'
    file.write_text(text)
    with pytest.raises(ValueError, match=f"datum_file: '{file}': .*{why}") as refused:
        read_datum(str(file))
    assert '\n' not in str(refused.value)


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(ValueError, match='datum_file: .*directory'):
        read_datum(str(tmp_path))


def test_a_pipe_is_refused_instead_of_waited_for(tmp_path):
    pipe = tmp_path / 'datum.yaml'
    os.mkfifo(pipe)
    with pytest.raises(ValueError, match='datum_file: .*pipe'):
        read_datum(str(pipe))


def test_a_link_of_somebody_else_is_not_followed(tmp_path):
    victim, file = tmp_path / 'victim', tmp_path / 'datum.yaml'
    victim.write_text('precious')
    for name in ('datum.yaml.new', 'datum.yaml'):
        (tmp_path / name).symlink_to(victim)
    write_datum(str(file), DATUM)
    assert victim.read_text() == 'precious'
    assert read_datum(str(file)) == DATUM


def test_what_cannot_be_written_leaves_nothing_behind(tmp_path):
    (tmp_path / 'datum.yaml').mkdir()
    with pytest.raises(OSError):
        write_datum(str(tmp_path / 'datum.yaml'), DATUM)
    assert [path.name for path in tmp_path.iterdir()] == ['datum.yaml']


def test_the_datum_of_the_parameters_stays(tmp_path):
    known = estimator_settings('navsat')
    assert known.origin().plane.datum == DATUM
    with pytest.raises(ValueError, match='datum_file: expected none beside a datum'):
        estimator_settings('navsat', {'datum_file': str(tmp_path / 'datum.yaml')}).origin()
    unknown = estimator_settings('navsat', {'datum': [float('inf')]})
    assert unknown.origin().plane is None


@pytest.mark.parametrize('datum', [[1.0], [1.0, 2.0], [91.0, 0.0, 0.0], [0.0, 0.0, float('nan')]])
def test_a_wrong_datum_is_refused(datum):
    with pytest.raises(ValueError, match='datum: expected'):
        estimator_settings('navsat', {'datum': datum})
