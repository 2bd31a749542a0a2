# SPDX-License-Identifier: Apache-2.0
"""Process noise that the class of a model has, and no parameter."""

from dataclasses import dataclass

import numpy as np
import pytest
from tools.strangers.injected.array_replay import replay

import kalman_ros as kr
from kalman_ros.analysis.diagnosis import model_noise
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.analysis.records import InputRecord

DT, START, STEPS, DENSITY = 0.02, 1000.0, 1500, 0.2


class Cart(kr.Model):
    """A cart whose forces are in its class."""

    state = kr.Space(('x', 'v'), ('m', 'm/s'))
    input = kr.Space((), ())

    def derivative(self, x, u):
        return np.stack([x[..., 1], -0.5 * x[..., 1]], axis=-1)

    def noise_density(self, x):
        return np.diag([0.0, DENSITY])


@dataclass(frozen=True)
class Frozen(Cart):
    """The same, of which no attribute can be set."""


class Periods(kr.DiscreteModel):
    """The same, step by step."""

    state = Cart.state
    input = Cart.input
    period = DT

    def next(self, x, u):
        return np.stack([x[..., 0] + DT * x[..., 1], 0.99 * x[..., 1]], axis=-1)

    def noise(self, x):
        return np.diag([0.0, DENSITY * DT])


def driven(model, rougher=1.0):
    """Return the evidence of a cart on a road that is rougher than its class says."""
    rng, x, places = np.random.default_rng(4), np.zeros(2), []
    for _ in range(STEPS):
        x = np.array([x[0] + DT * x[1], (1.0 - 0.5 * DT) * x[1]])
        x[1] += (rougher * DENSITY * DT) ** 0.5 * rng.normal()
        places.append(x[0] + 0.01 * rng.normal())
    stamp = START + DT * np.arange(STEPS)
    given = {
        'model': f'{__name__}:{model.__name__}', 'rate': 1.0 / DT, 'sensors': ['place'],
        'place.measures': ['x'], 'place.noise': [0.01], 'place.rate': 1.0 / DT,
        'place.type': 'sensor_msgs/JointState', 'place.fields': ['position[x]'],
        'initial_estimate': [0.0, 0.0], 'initial_std': [0.1, 0.1],
    }  # fmt: skip
    taken = {'place': (stamp + 1e-3, stamp, np.array(places)[:, None], None)}
    return replay(given, taken, InputRecord(np.zeros(0), np.zeros(0), np.zeros((0, 0))))


@pytest.mark.slow
@pytest.mark.parametrize('model', [Cart, Periods])
def test_the_noise_of_a_class_is_found_with_its_factor(model):
    findings = diagnose(driven(model, 6.0), proofs=False).findings
    assert [(each.kind, each.subject) for each in findings] == [
        ('process noise too small', model_noise.WHOLE)
    ]
    assert findings[0].density.factor == pytest.approx(6.0**0.5, rel=0.2)
    assert findings[0].sentence.endswith(
        'no parameter of that name scales it: multiply what the model returns.'
    )
    assert findings[0].change == {}
    x, factor = np.zeros(2), findings[0].density.factor
    mended = findings[0].mended().scenario.model.noise_density(x)
    assert mended[1, 1] == pytest.approx(factor**2 * DENSITY)
    assert diagnose(driven(model), proofs=False).findings == ()


@pytest.mark.slow
@pytest.mark.parametrize('model', [Cart, Frozen, Periods])
def test_the_model_is_multiplied_once_and_again(model):
    evidence = driven(model)
    twice = evidence.noisier(3.0).noisier(2.0)
    adopted = twice.adopting({'place.noise': [0.02]})
    x = np.zeros(2)
    before = evidence.scenario.model.noise_density(x)
    for changed in (twice, adopted):
        np.testing.assert_allclose(changed.scenario.model.noise_density(x), 6.0 * before)
        assert Examination(changed).densities.keys() == {model_noise.WHOLE}
    np.testing.assert_allclose(before[1, 1], DENSITY)
    back = twice.noisier(1.0 / 6.0).scenario.model
    np.testing.assert_allclose(back.noise_density(x), before)
