# SPDX-License-Identifier: Apache-2.0
"""The examples of identification find the numbers of recordings that are made here."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from scipy.linalg import expm

from kalman_ros.compiled.parts import VARIABLE

pytest.importorskip('casadi', reason='without compiled models it takes minutes')
FOLDER = Path(__file__).parents[2] / 'docs' / 'examples' / 'identification'


@pytest.fixture
def example(monkeypatch):
    monkeypatch.syspath_prepend(FOLDER)
    return lambda name: __import__(name)


def within(found, truth, deviations=3.0):
    for name, value in truth.items():
        mine = found.parameters[name]
        std = (mine.high - mine.low) / (2.0 * 1.96)
        assert abs(mine.value - value) < deviations * std, (name, mine)
        assert std < 0.3 * abs(value)


@pytest.mark.thorough
@pytest.mark.slow
def test_a_house_has_its_resistances_and_capacities(example, tmp_path, capsys, monkeypatch):
    house = example('house')
    truth = {name: value for name, (value, _) in house.PUBLISHED.items()}
    Ro, Ri, Cw, Ci, wander, error, first = truth.values()
    rng, time = np.random.default_rng(3), 1800.0 * np.arange(241)
    outside = 15.0 + 5.0 * np.sin(time / 86400.0 * 2.0 * np.pi)
    heating = 1000.0 * (np.sin(time / 40_000.0) > 0.0)
    days, steps = time / 86400.0, 20
    dt = days[1] / steps
    A = np.array(
        [[-1 / (Cw * Ri) - 1 / (Cw * Ro), 1 / (Cw * Ri)], [1 / (Ci * Ri), -1 / (Ci * Ri)]]
    )
    F, x, inside = expm(A * dt), np.array([first, 26.7]), []
    for k in range(len(time)):
        inside.append(x[1] + error * rng.normal())
        for step in range(steps):
            share = (step + 0.5) / steps
            To, Q = (
                (1.0 - share) * each[k] + share * each[min(k + 1, len(time) - 1)]
                for each in (outside, heating)
            )
            x = F @ x + dt * np.array([To / (Cw * Ro), Q / Ci])
            x[0] += wander * dt**0.5 * rng.normal()
    table = np.column_stack((time, outside, heating, 0.0 * time, inside))
    file = tmp_path / 'house.csv'
    np.savetxt(file, table, delimiter=',', header='Time,T_ext,P_hea,I_sol,T_int', comments='')
    within(house.fit(file), {name: truth[name] for name in ('Ro', 'Ri', 'Cw', 'Ci', 'first')})
    monkeypatch.setattr(sys, 'argv', ['house.py', str(file)])
    house.main()
    assert '169.597 ± 7.7' in capsys.readouterr().out


@pytest.mark.thorough
def test_a_drive_has_its_mass_and_friction(example, tmp_path, monkeypatch):
    monkeypatch.delenv(VARIABLE)  # by numpy it takes minutes
    drive = example('drive')
    truth = {name: value for name, (value, _) in drive.PUBLISHED.items()}
    M, Fv, Fc, offset = truth.values()
    rng, dt, count = np.random.default_rng(5), 1e-3, 6000
    x, v, place, volts = 0.0, 0.0, [], []
    for k in range(count):
        wish = 0.1 * np.sin(2.0 * np.pi * k * dt / 1.5) * np.sin(2.0 * np.pi * k * dt / 7.0)
        if k % drive.EVERY == 0:
            force = 2000.0 * (wish - v) + 40.0 * np.sin(k * dt * 9.0) + offset
        place.append(x)
        volts.append(force / 35.0)
        for _ in range(10):
            push = 3.0 * rng.normal() / (0.1 * dt) ** 0.5
            rate = (force - Fv * v - Fc * np.tanh(v / drive.SLOW) - offset + push) / M
            x, v = x + 0.1 * dt * v, v + 0.1 * dt * rate
    read = drive.STEP * np.round(np.array(place) / drive.STEP)
    file = tmp_path / 'drive.mat'
    savemat(file, {'qm': read[:, None], 'vir': np.array(volts)[:, None], 'gtau': 35.0})
    within(drive.fit(file), {'M': M, 'Fc': Fc})
