# SPDX-License-Identifier: Apache-2.0
"""The likelihood of a walk of a sensor is that of all readings as one Gaussian vector."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from kalman_ros.analysis.diagnosis import coloured, common_noise, error_filter, wandering
from kalman_ros.analysis.diagnosis.passage import Event, Passage, whitener

F, Q, H, R, DT = (
    np.array([[1.0, 0.1], [0.0, 0.95]]),
    np.diag([1e-3, 2e-2]),
    np.eye(1, 2),
    0.04,
    0.1,
)
OTHER = np.array([[0.3, 1.0]])
FIRST = np.diag([0.5, 0.2])


def recorded(count=25, density=0.5, seed=3):
    """Return the readings of two sensors in turn, of which the first one wanders."""
    rng = np.random.default_rng(seed)
    x, b = rng.multivariate_normal(np.zeros(2), FIRST), rng.normal() * density**0.5
    readings = []
    for k in range(count):
        H_k, offset = (H, b) if k % 2 == 0 else (OTHER, 0.0)
        readings.append(H_k @ x + offset + R**0.5 * rng.normal(size=1))
        x = F @ x + rng.multivariate_normal(np.zeros(2), Q)
        b += rng.normal() * (density * DT) ** 0.5
    return readings


def passed(readings):
    """Return the pass of a Kalman filter without the walk."""
    x, P, events, whitened = np.zeros(2), FIRST, [], []
    for k, y in enumerate(readings):
        if k:
            x, P = F @ x, F @ P @ F.T + Q
        H_k = H if k % 2 == 0 else OTHER
        nu, S = y - H_k @ x, H_k @ P @ H_k.T + R
        K = P @ H_k.T / S
        white, size = whitener(S)
        name = 'first' if k % 2 == 0 else 'second'
        known = x, P, np.zeros(0), H_k, np.array([[R]]), K, S, nu, white, size
        events.append(Event(name, k // 2, k * DT, F, Q, DT, *known))
        whitened.append(white @ nu)
        x, P = x + K @ nu, P - K @ S @ K.T
    return Passage(events, whitened)


def error(readings, density, *decay, **options):
    """Return the filter of an error of the first sensor."""
    steps = wandering._steps(passed(readings), 'first', [0])
    return wandering._filtered(steps, density, *decay, **options)


def covariance(count, density, time=0.0):
    """Return the covariance of all readings, from that of states and offsets at all steps.

    The offset is a walk, or with a ``time`` noise of the declared size that is correlated so long.
    """
    size = 2 * count
    states, P = np.zeros((size, size)), FIRST
    for k in range(count):
        states[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = P
        A = np.eye(2)
        for j in range(k + 1, count):
            A = F @ A
            states[2 * j : 2 * j + 2, 2 * k : 2 * k + 2] = A @ P
            states[2 * k : 2 * k + 2, 2 * j : 2 * j + 2] = (A @ P).T
        P = F @ P @ F.T + Q
    read = np.zeros((count, size))
    for k in range(count):
        read[k, 2 * k : 2 * k + 2] = (H if k % 2 == 0 else OTHER)[0]
    steps = np.arange(count)
    wanders = steps % 2 == 0
    error, white = density * (1.0 + DT * np.minimum.outer(steps, steps)), 1.0
    if time:
        error = R * np.exp(-DT / time * np.abs(np.subtract.outer(steps, steps)))
        white = wandering._WHITE
    noise = R * np.diag(np.where(wanders, white, 1.0))
    return read @ states @ read.T + noise + error * np.outer(wanders, wanders)


def misfit(readings, density, time=0.0):
    y, S = np.concatenate(readings), covariance(len(readings), density, time)
    return y @ np.linalg.solve(S, y) + np.linalg.slogdet(2.0 * np.pi * S)[1]


@pytest.mark.parametrize('density', [1e-3, 0.1, 2.0])
def test_its_likelihood_is_that_of_all_readings_at_once(density):
    readings = recorded()
    found = error(readings, np.array([[density]]))
    assert passed(readings).misfit == pytest.approx(misfit(readings, 0.0), rel=1e-10)
    assert found.misfit == pytest.approx(misfit(readings, density), rel=1e-10)


@pytest.mark.parametrize('share', [0.3, -0.9])
def test_the_likelihood_of_noise_in_common(share):
    """Of each reading of the first sensor but one with the next one of the second."""
    readings = recorded(density=0.0)
    given, starts = passed(readings), np.array([*range(0, 6, 2), *range(8, 24, 2)])
    pair = common_noise._Pair(
        ('first', 'second'), np.zeros((1, 2), dtype=int), np.sign([share]),
        np.column_stack((starts // 2, starts // 2)),
    )  # fmt: skip
    y, S = np.concatenate(readings), covariance(25, 0.0)
    S[starts, starts + 1] += share * R
    S[starts + 1, starts] += share * R
    expected = y @ np.linalg.solve(S, y) + np.linalg.slogdet(2.0 * np.pi * S)[1]
    found = common_noise._with_common(given, pair, abs(share))
    assert found.misfit == pytest.approx(expected, rel=1e-10)
    # the path is the same at both readings of a pair
    one, other = (found.path(given.of(name)[starts // 2]) for name in pair.names)
    np.testing.assert_allclose(one, other, atol=1e-6)


@pytest.mark.parametrize('time', [0.05, 0.4, 3.0])
def test_the_likelihood_of_noise_that_is_correlated_in_time(time):
    readings = recorded()
    noise = np.array([[2.0 * R / time]])
    found = error(readings, noise, 1.0 / time, white=wandering._WHITE)
    assert found.misfit == pytest.approx(misfit(readings, 0.0, time), rel=1e-10)


@pytest.mark.slow
def test_smaller_noise_that_stays_white_is_the_simpler_cause():
    readings = recorded(200, density=0.0)
    for k in range(0, 200, 2):
        readings[k] = readings[k] - 0.8 * R**0.5 * _white_of(
            200, k
        )  # a fifth of the noise is left
    given = passed(readings)
    shares = [np.where(np.arange(200) % 2, 1.0, share) for share in wandering._SMALLER]
    y, whole = np.concatenate(readings), covariance(200, 0.0)
    first = np.where(np.arange(200) % 2, 0.0, 1.0)  # whose constant is unknown
    anywhere = R * wandering._ANYWHERE**2 * np.outer(first, first)
    best = min(
        y @ np.linalg.solve(S, y) + np.linalg.slogdet(2.0 * np.pi * S)[1]
        for S in (whole + anywhere + R * np.diag(share - 1.0) for share in shares)
    )
    gain = wandering.whiter(given, 'first', np.array([[R]]))
    assert gain == pytest.approx(given.misfit - best, rel=1e-8) and gain > 30.0
    found, _, _ = wandering.coloured(given, 'first', np.array([[R]]))
    assert found < 1.5 * gain


@pytest.mark.slow
def test_the_likeliest_time_of_noise_is_found():
    """At some of the trial times, of which the best ones have neighbours."""
    rng, time, count = np.random.default_rng(5), 2.0, 600
    readings, error = recorded(count, density=0.0), 0.0
    for k in range(0, count, 2):
        left = np.exp(-2.0 * DT / time)
        error = left * error + (R * (1.0 - left**2)) ** 0.5 * rng.normal()
        readings[k] = readings[k] - R**0.5 * _white_of(count, k) + error
    given = passed(readings)
    gain, found, path = wandering.coloured(given, 'first', np.array([[R]]))
    assert 0.5 * time < found < 2.5 * time and gain > 100.0
    assert path.shape == (count // 2, 1)
    assert gain == pytest.approx(given.misfit - misfit(readings, 0.0, found), rel=1e-6)


def _white_of(count, k, seed=3):
    """Return the white noise of a reading of `recorded`, in deviations."""
    rng = np.random.default_rng(seed)
    rng.multivariate_normal(np.zeros(2), FIRST), rng.normal()
    for step in range(count):
        noise = rng.normal(size=1)
        if step == k:
            return noise
        rng.multivariate_normal(np.zeros(2), Q)
        rng.normal()
    raise IndexError(k)


def test_the_likeliest_intensity_is_found_from_a_coarse_one():
    readings = recorded()
    gains = []
    for start in (0.5 / 64.0, 0.5, 0.5 * 64.0):
        gain, path = wandering.likeliest(passed(readings), 'first', [0], np.array([start]))
        assert path.shape == (13, 1)
        gains.append(gain)
    best = max(misfit(readings, 0.0) - misfit(readings, 0.5 * 4.0**k) for k in range(-3, 4))
    np.testing.assert_allclose(gains, best, rtol=1e-9)


@pytest.mark.slow
def test_drawn_paths_scatter_as_the_offset_does_given_the_readings(monkeypatch):
    readings, density = recorded(), 0.5
    walk = error(readings, np.array([[density]]))
    paths = []
    for seed in range(400):
        monkeypatch.setattr(error_filter, '_SEED', seed)
        paths.append(walk.path(np.arange(0, 25, 2))[:, 0])
    # by the rules of conditional Gaussians
    steps = np.arange(25)
    prior = density * (1.0 + DT * np.minimum.outer(steps, steps))
    together = prior * (steps % 2 == 0)  # the offset with each reading
    solved = np.linalg.solve(covariance(25, density), together.T)
    mean = (solved.T @ np.concatenate(readings))[::2]
    std = np.sqrt(np.diagonal(prior - together @ solved))[::2]
    assert np.abs(np.mean(paths, axis=0) - mean).max() < 4.0 * std.max() / 400**0.5
    np.testing.assert_allclose(np.std(paths, axis=0), std, rtol=0.15)


def test_the_same_recording_has_the_same_path():
    given = passed(recorded()), 'first', [0], np.array([0.5])
    np.testing.assert_array_equal(wandering.likeliest(*given)[1], wandering.likeliest(*given)[1])


def test_a_state_that_is_known_exactly_does_no_harm():
    first, *others = passed(recorded()).events
    known = replace(first, P=0.0 * first.P, S=first.S - H @ FIRST @ H.T)
    events = [known, *others]
    given = Passage(events, [event.white @ event.innovation for event in events])
    gain, path = wandering.likeliest(given, 'first', [0], np.array([0.5]))
    assert np.isfinite(gain) and np.isfinite(path).all()


@pytest.mark.parametrize(
    ('offset', 'walks'),
    [('walk', True), ('scale', False), ('crossed', False), ('jumps', False), ('half', True)],
)
def test_a_walk_moves_by_chance_and_not_with_the_readings(offset, walks):
    rng = np.random.default_rng(5)
    times = np.arange(2000) * 0.05
    read = np.column_stack([np.sin(0.3 * times), np.sin(0.17 * times + 1.0)])
    walk = np.cumsum(0.02 * rng.normal(size=2000))
    jumps = np.where(rng.random(2000) < 0.004, rng.normal(size=2000), 0.0)
    paths = {
        'walk': walk, 'scale': 0.1 * read[:, 0], 'crossed': 0.1 * read[:, 1],
        'jumps': np.cumsum(jumps), 'half': walk + 0.01 * read[:, 0],
    }  # fmt: skip
    assert wandering.is_walk(times, paths[offset][:, None], read) is walks


def test_what_does_not_move_at_all_or_is_short_is_no_evidence_against_a_walk():
    assert wandering.is_walk(np.arange(100.0), np.zeros((100, 1)), np.ones((100, 1)))
    assert wandering.is_walk(np.arange(3.0), np.arange(3.0)[:, None], np.arange(3.0)[:, None])


def test_noise_of_no_size_is_not_examined(monkeypatch):
    """A sensor that is exact by declaration has a covariance without an inverse."""
    readings = recorded(240, density=0.0)
    given = passed(readings)

    def singular(*_):
        raise np.linalg.LinAlgError('singular')

    monkeypatch.setattr(coloured.wandering, 'coloured', singular)
    monkeypatch.setattr(coloured, '_is_suspect', lambda _: True)
    record = SimpleNamespace(covariance=np.full((120, 1, 1), R))
    evidence = SimpleNamespace(sensors={'first': record, 'second': record})
    case = SimpleNamespace(passage=given, judged=['first', 'second'], evidence=evidence)
    assert list(coloured.find(case)) == []


@pytest.mark.parametrize(('white', 'count'), [(80.0, 1), (90.0, 0)])
def test_smaller_white_noise_that_explains_nearly_as_much_is_preferred(monkeypatch, white, count):
    given = passed(recorded(240, density=0.0))
    monkeypatch.setattr(coloured.wandering, 'coloured', lambda *_: (100.0, 1.0, None))
    monkeypatch.setattr(coloured.wandering, 'whiter', lambda *_: white)
    monkeypatch.setattr(coloured, '_is_suspect', lambda _: True)
    monkeypatch.setattr(coloured, '_coloured', lambda *_: 'finding')
    record = SimpleNamespace(covariance=np.full((120, 1, 1), R))
    evidence = SimpleNamespace(sensors={'first': record})
    case = SimpleNamespace(passage=given, judged=['first'], evidence=evidence)
    assert list(coloured.find(case)) == ['finding'] * count
