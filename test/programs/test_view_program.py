# SPDX-License-Identifier: Apache-2.0
"""What `view` refuses, in one line, before anything is started; and the files that it writes."""

import argparse
import json

import pytest

pytest.importorskip('rclpy')
pytest.importorskip('foxglove')

from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.programs.view import arguments, main
from kalman_ros.programs.viewing import Viewing

WRONG = {
    'no_such': "'no_such'",
    'cart_pole --rviz x.rviz': '--rviz: expected a state with x and y',
    'no_such.mcap': "there is no recording 'no_such.mcap'",
    '.': 'is no recording',
    '--domain 300': '--domain: expected 0 to 232, got 300',
    '--domain -1': '--domain: expected 0 to 232, got -1',
    '--port 0': '--port: expected 1 to 65535, got 0',
    '--listen here': "--listen: expected an IP address, got 'here'",
    '--page localhost:8080': '--page: expected an origin, such as http://localhost:8080, got',
    '-p nonsense:=1': "unknown parameter 'nonsense'",
    'mass_sprin': "unknown scenario 'mass_sprin'; did you mean 'mass_spring_damper'?\n",
    '--layout /proc/x/y.json': '--layout: cannot write /proc/x/y.json: No such file',
    '--rviz /': '--rviz: cannot write /: Is a directory',
}


@pytest.mark.parametrize('line', WRONG)
def test_what_is_wrong_is_one_line(line, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as exit:
        main(line.split())
    assert exit.value.code == 2
    error = capsys.readouterr().err
    assert WRONG[line] in error
    assert error.startswith('view: ')
    assert error.count('\n') == 1


def test_the_files_of_a_scenario_are_written_for_a_recording_too(tmp_path, monkeypatch):
    with RecordingWriter(tmp_path / 'bag') as writer:
        writer.add('/x', 'std_msgs/msg/Float64')
        writer.write('/x', 1, bytes(12))
    served = []
    monkeypatch.setattr(Viewing, '_serve_recording', lambda _, bag: served.append(bag.path))
    layout, rviz = tmp_path / 'new' / 'a.json', tmp_path / 'a.rviz'
    options = arguments(
        [str(tmp_path / 'bag'), '--params-file', 'two_bearings', '--layout', str(layout),
         '--rviz', str(rviz)]
    )  # fmt: skip
    assert isinstance(options, argparse.Namespace)
    Viewing(options).run()
    assert served == [tmp_path / 'bag']
    assert 'innovation of west' in layout.read_text()
    assert json.loads(layout.read_text())['layout']
    assert '/markers' in rviz.read_text()
