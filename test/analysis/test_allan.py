# SPDX-License-Identifier: Apache-2.0
"""The Allan deviation against published values, and noise whose parameters are known."""

import numpy as np
import pytest
from scipy.stats import chi2

from kalman_ros.analysis.allan import Allan, Parameter, allan, overlapping_variance


def published():
    """The 1000 points of NIST SP 1065, section 12.4: a linear congruential generator."""
    state, found = 1234567890, []
    for _ in range(1000):
        found.append(state / 2147483647)
        state = 16807 * state % 2147483647
    return np.array(found)


def test_the_test_set_of_nist():
    """SP 1065, table 31: the overlapping Allan deviation at averaging factors 1, 10 and 100."""
    values = published()
    assert values.mean() == pytest.approx(4.897745e-1, rel=1e-6)
    found = np.sqrt(overlapping_variance(values, np.array([1, 10, 100])))
    np.testing.assert_allclose(found, [2.922319e-1, 9.159953e-2, 3.241343e-2], rtol=2e-7)


def noise(rng, count, period, density, walk):
    white = rng.normal(0.0, density / np.sqrt(period), count)
    return white + np.cumsum(rng.normal(0.0, walk * np.sqrt(period), count))


def flicker(rng, count, level):
    """Noise with a spectrum of level^2 / (2 pi f), shaped in the frequency domain."""
    frequency = np.fft.rfftfreq(2 * count)
    spectrum = np.fft.rfft(rng.normal(size=2 * count))
    spectrum[1:] /= np.sqrt(2.0 * np.pi * frequency[1:])
    spectrum[0] = 0.0
    return level * np.fft.irfft(spectrum)[:count]


@pytest.mark.thorough
@pytest.mark.slow
def test_the_intervals_cover_what_the_noise_was_made_of():
    """About 95 in 100 would; neighbouring averaging times share their data."""
    density, walk, period = 0.01, 0.004, 0.01
    covered = np.zeros(2)
    for seed in range(60):
        found = allan(noise(np.random.default_rng(seed), 30_000, period, density, walk), period)
        assert found.density.determined
        for index, (true, each) in enumerate(
            ((density, found.density), (walk, found.random_walk))
        ):
            covered[index] += each.low <= true <= each.high
    assert (covered >= 0.85 * 60).all(), covered


@pytest.mark.slow
def test_a_flat_part_is_the_bias_instability():
    period, level = 0.01, 0.002
    rng = np.random.default_rng(1)
    values = flicker(rng, 400_000, level) + rng.normal(0.0, 0.001 / np.sqrt(period), 400_000)
    found = allan(values, period)
    assert found.instability.determined
    assert found.instability.low < level < found.instability.high
    assert found.instability.value == pytest.approx(level, rel=0.15)
    assert found.needed() == found.duration == pytest.approx(4000.0)


def test_what_a_short_recording_does_not_tell_is_not_told():
    found = allan(np.random.default_rng(2).normal(0.0, 0.1, 3000), 0.01)
    assert found.density.value == pytest.approx(0.01, rel=0.1)
    assert not found.instability.determined
    assert not found.random_walk.determined
    assert found.needed() > found.duration


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        (np.zeros(99), 'at least 100 readings, got 99'),
        (np.full(200, np.nan), 'finite'),
        (np.full(200, 9.81), 'all readings are equal'),
    ],
)
def test_what_has_no_deviation_is_refused(values, message):
    with pytest.raises(ValueError, match=message):
        allan(values, 0.01)


@pytest.mark.parametrize(
    ('N', 'B', 'K'), [(0.01, 0.02, 0.004), (0.01, 0.0, 0.004), (0.3, 0.1, 0.9)]
)
def test_an_exact_deviation_gives_back_its_parameters(monkeypatch, N, B, K):
    """IEEE Std 952, annex C: N^2 / t + 2 ln 2 / pi B^2 + K^2 t / 3."""
    period = 0.01

    def exact(values, factors):
        t = factors * period
        return N**2 / t + 2.0 * np.log(2.0) / np.pi * B**2 + K**2 * t / 3.0

    monkeypatch.setattr('kalman_ros.analysis.allan.overlapping_variance', exact)
    found = allan(np.arange(30_000.0), period)
    parameters = found.density, found.instability, found.random_walk
    np.testing.assert_allclose(
        [each.value for each in parameters], [N, B, K], rtol=1e-4, atol=1e-6
    )


@pytest.mark.parametrize(
    ('low', 'high', 'times'),
    [(1.0, 2.9, 1.0), (1.0, 9.0, 4.0), (1.0, 27.0, 9.0), (1.0, 1e3, 10.0), (0.0, 1.0, 10.0)],
)
def test_degrees_of_freedom_grow_with_the_duration(low, high, times):
    """So the logarithm of the interval shrinks with its square root."""
    nothing = np.zeros(0)
    parameter = Parameter(2.0, low, high, 10.0)
    found = Allan(
        nothing, nothing, nothing, nothing, nothing, parameter, parameter, parameter, 60.0
    )
    assert found.needed() == pytest.approx(60.0 * times)


def known_terms(monkeypatch, N=0.0, B=0.0, K=0.0):
    """Let every recording have the deviation of IEEE Std 952, annex C, at a period of 1 s."""

    def exact(values, factors):
        return N**2 / factors + 2.0 * np.log(2.0) / np.pi * B**2 + K**2 * factors / 3.0

    monkeypatch.setattr('kalman_ros.analysis.allan.overlapping_variance', exact)


#: NIST SP 1065, table 5: degrees of freedom by the number of sums and the averaging factor.
DEGREES = {
    'N': lambda N, m: (1.5 * (N - 1) / m - 2 * (N - 2) / N) * 4 * m**2 / (4 * m**2 + 5),
    'B': lambda N, m: (
        5 * N**2 / (4 * m * (N + 3 * m)) if m > 1 else 2 * (N - 2) ** 2 / (2.3 * N - 4.9)
    ),
    'K': lambda N, m: (N - 2) / m * ((N - 1) ** 2 - 3 * m * (N - 1) + 4 * m**2) / (N - 3) ** 2,
}


@pytest.mark.parametrize('term', DEGREES)
@pytest.mark.parametrize('count', [100, 5000])
def test_the_intervals_have_the_degrees_of_freedom_of_the_noise(monkeypatch, term, count):
    known_terms(monkeypatch, **{term: 0.1})
    found = allan(np.arange(float(count)), 1.0)
    for m, deviation, low, high in zip(found.time, found.deviation, found.low, found.high):
        degrees = max(DEGREES[term](count + 1, m), 1.0)
        bounds = chi2.ppf([0.975, 0.025], degrees) / degrees
        np.testing.assert_allclose([low, high], deviation / np.sqrt(bounds), rtol=1e-6)


def test_a_parameter_with_a_small_share_of_the_variance_is_that_much_less_certain(monkeypatch):
    """What the whole is wrong by, relative to it, counts for a part by its share."""
    known_terms(monkeypatch, B=0.1)
    alone = allan(np.arange(1e6), 1.0).instability
    known_terms(monkeypatch, N=0.1, B=0.1, K=0.1)
    found = allan(np.arange(1e6), 1.0)
    among, t = found.instability, found.time
    flat = 2.0 * np.log(2.0) / np.pi
    share = np.max(flat / (1.0 / t + flat + t / 3.0))
    assert share < 0.3
    widths = [np.log(each.high / each.low) for each in (alone, among)]
    assert widths[1] * share == pytest.approx(widths[0], rel=0.1)
