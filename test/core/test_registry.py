# SPDX-License-Identifier: Apache-2.0
import sys

import pytest

from kalman_ros.core.registry import find


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
