# SPDX-License-Identifier: Apache-2.0
"""A sensor behind a low-pass filter: its effect is the solution of its equation."""

from types import SimpleNamespace

import numpy as np
import pytest
from tools.strangers.injected.recordings import recorded

import kalman_ros as kr
from kalman_ros.analysis.diagnosis import lag
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.passage import Passage


def passed(times, values):
    """Return a pass whose predictions are ``values`` (N,), read at every second event."""
    names = ['y' if k % 2 == 0 else 'other' for k in range(len(times))]
    events = [
        SimpleNamespace(sensor=name, time=t, x=np.array([x]))
        for name, t, x in zip(names, times, values)
    ]
    return Passage(events, [np.zeros(1)] * len(events))


def evidence_of(sensor):
    source = SimpleNamespace(sensor=sensor)
    return SimpleNamespace(scenario=SimpleNamespace(sensors={'y': source}))


@pytest.mark.parametrize('tau', [0.02, 0.3, 5.0])
def test_a_lag_follows_a_ramp_and_a_sine_as_its_equation_does(tau):
    times = np.cumsum(np.random.default_rng(1).uniform(0.0, 2e-3, 3000))
    times[100] = times[99]  # readings of the same instant
    sensor = (
        kr.make_scenario(kr.continuous_model([[0.0]], W=[1.0]), {'y': ([1.0], 1.0)}, rate=10.0)
        .sensors['y']
        .sensor
    )
    # tau y' = h - y from y = h: the solutions for h = t and for h = sin w t
    w, t = 2.0, times - times[0]
    ramp = -tau * (1.0 - np.exp(-t / tau))
    gain = 1.0 / (1.0 + (w * tau) ** 2)
    sine = gain * (np.sin(w * t) - w * tau * (np.cos(w * t) - np.exp(-t / tau))) - np.sin(w * t)
    for values, expected in ((t, ramp), (np.sin(w * t), sine)):
        found = lag.behind(passed(times, values), evidence_of(sensor), 'y', [tau])[:, 0, 0]
        np.testing.assert_allclose(found, expected[::2], atol=2e-6)
    none = lag.behind(passed(times, t), evidence_of(sensor), 'y', [0.0])
    assert np.abs(none).max() < 1e-11


def test_a_heading_that_goes_round_has_no_jump_behind_a_lag():
    space = kr.load('turn_rate').model.state
    heading = space.names.index(space.angles[0])
    sensor = SimpleNamespace(measure=lambda x: x, output=space)
    angle = np.arange(0.0, 12.0, 0.01)
    events = [
        SimpleNamespace(sensor='y', time=float(a), x=space.wrap(a * np.eye(space.size)[heading]))
        for a in angle
    ]
    found = lag.behind(
        Passage(events, [np.zeros(1)] * len(events)), evidence_of(sensor), 'y', [0.5]
    )
    np.testing.assert_allclose(found[-1, heading, 0], -0.5, atol=1e-6)


@pytest.fixture(scope='module')
def spring():
    return recorded('mass_spring_damper', None, 20.0, 4)


@pytest.mark.slow
@pytest.mark.parametrize('tau', [0.2, 0.6])
def test_a_slow_sensor_is_found_with_its_time_constant(spring, tau):
    record = spring.sensors['velocity']
    value, kept = record.value.copy(), np.exp(-np.diff(record.stamp) / tau)
    truth = recorded('mass_spring_damper', None, 20.0, 4).sensors['velocity'].value
    smooth = np.convolve(truth[:, 0], np.ones(9) / 9.0, 'same')  # of the noise a ninth is left
    noise = truth[:, 0] - smooth
    y = smooth[0]
    for k, a in enumerate(kept, start=1):
        y = a * y + (1.0 - a) * 0.5 * (smooth[k] + smooth[k - 1])
        value[k, 0] = y + noise[k]
    finding = diagnose(spring.with_values('velocity', value)).findings[0]
    assert (finding.kind, finding.subject) == ('lag', 'velocity')
    size = float(finding.sentence.partition('time constant of ')[2].split()[0])
    assert size == pytest.approx(tau, rel=0.35)
