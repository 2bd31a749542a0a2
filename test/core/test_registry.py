# SPDX-License-Identifier: Apache-2.0
import sys

import pytest

from kalman_ros import scenario, sensors
from kalman_ros.core import Space
from kalman_ros.core.registry import find
from kalman_ros.scenario import wiring


@pytest.mark.parametrize(
    ('source', 'says'),
    [
        ('x = 1\nclass A(Model): ...\n', "NameError: name 'Model' is not defined, own_robot.py l"),
        ('raise RuntimeError("no gears")\n', 'RuntimeError: no gears, own_robot.py line 1'),
        ('import gears\n', "No module named 'gears'; is its folder on PYTHONPATH"),
        ('x = 1\n', "has no attribute 'A'"),
    ],
)
def test_a_module_that_does_not_load_is_one_line(tmp_path, monkeypatch, source, says):
    (tmp_path / 'own_robot.py').write_text(source)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, 'own_robot', raising=False)
    with pytest.raises(ValueError, match="model: cannot load 'own_robot:A': ") as raised:
        find('model', 'own_robot:A', 'kalman_ros.models', 'SYSTEM')
    assert says in str(raised.value)
    assert '\n' not in str(raised.value)


MINE = """
import sys
from kalman_ros.core import LinearSystem, Model
from kalman_ros.scenario.wiring import system

SYSTEM = system('mass_spring_damper')
from kalman_ros.sensors.states import States

called = []

def bare():
    called.append('bare')

def other() -> int:
    called.append('other')

def model() -> Model:
    return SYSTEM.build()

class Eye(States):
    pass

class Impostor:
    def __init__(self, *_):
        called.append('impostor')
"""


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """Return a user's module with objects to name."""
    (tmp_path / 'mine_own.py').write_text(MINE)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, 'mine_own', raising=False)
    import mine_own

    return mine_own


@pytest.mark.parametrize('name', ['bare', 'other', 'Impostor', 'called', 'Eye', 'sys'])
def test_what_is_no_model_is_not_called(mine, name):
    with pytest.raises(ValueError, match=f"model: 'mine_own:{name}' is not a System, a Model or"):
        wiring.system(f'mine_own:{name}')
    assert not mine.called


@pytest.mark.parametrize('name', ['bare', 'other', 'Impostor', 'called', 'model'])
def test_what_is_no_sensor_is_not_called(mine, name):
    with pytest.raises(ValueError, match=f"kind: 'mine_own:{name}' is not a Sensor class or a f"):
        sensors.build(f'mine_own:{name}', Space(('x',), ('m',)), [1.0], {})
    assert not mine.called


def test_a_class_a_system_and_an_annotated_function_are_allowed(mine):
    assert wiring.system('mine_own:SYSTEM') is mine.SYSTEM
    assert wiring.system('mine_own:model').build is mine.model
    built = sensors.build('mine_own:Eye', Space(('x',), ('m',)), [1.0], {'measures': ['x']})
    assert isinstance(built, mine.Eye)


@pytest.mark.parametrize('name', ['os:abort', 'tempfile:mkdtemp', 'builtins:exit'])
def test_names_of_the_library_are_not_called(name):
    with pytest.raises(ValueError, match='is not a System'):
        scenario.build({'model': name})
    with pytest.raises(ValueError, match=r'position.kind: .* is not a Sensor class'):
        scenario.build({'position.kind': name})
