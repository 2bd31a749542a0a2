# SPDX-License-Identifier: Apache-2.0
"""Directions of sound: as good as can be, and as good as they say, from clear to poor."""

import numpy as np
import pytest
from seeds import first_fast
from thorough import mostly_thorough

from kalman_ros.acoustics.array import MicrophoneArray
from kalman_ros.acoustics.arrival import DirectionFinder
from kalman_ros.estimators.consistency import chi_square_bounds
from kalman_ros.simulation.sound import SimulatedSound, Sound

RATE, SAMPLES, BAND = 16000.0, 1600, (200.0, 3000.0)
RADIUS = 0.1


def circle(count, radius):
    angles = 2.0 * np.pi * np.arange(count) / count
    return radius * np.stack((np.cos(angles), np.sin(angles)), axis=-1)


ARRAY = MicrophoneArray(circle(6, RADIUS))
FINDER = DirectionFinder(ARRAY, RATE, SAMPLES, BAND)
RANGE = 100.0
LEAST_EVIDENCE = np.log(1000.0)
RUNS = 200


def difference(a, b):
    return (a - b + np.pi) % (2.0 * np.pi) - np.pi


def sound(decibel, band=BAND, listened=BAND):
    """Return a sound whose power in its band is so much above the noise there, at `RANGE`."""
    share = (band[1] - band[0]) / (RATE / 2.0)
    return Sound(10.0 ** (decibel / 20.0) * RANGE * np.sqrt(share), band, 1.0)


def frames(decibel, runs=RUNS, array=ARRAY, **options):
    """Yield true bearings, and frames of sound from there."""
    rng = np.random.default_rng(int(100 + decibel))
    hear = SimulatedSound(array, RATE, SAMPLES, sound(decibel, **options), seed=1)
    for bearing in rng.uniform(-np.pi, np.pi, runs):
        yield bearing, hear(RANGE * np.array([np.cos(bearing), np.sin(bearing)]))


def found(decibel, finder=FINDER, **options):
    """Return errors, variances and evidence (RUNS,) of bearings."""
    rows = []
    for bearing, frame in frames(decibel, **options):
        arrival = finder(frame)
        rows.append((difference(arrival.bearing, bearing), arrival.variance, arrival.evidence))
    return np.array(rows).T


def least_variance(decibel):
    """Return the bound of Cramer and Rao for a source and noise of unknown powers.

    With s the ratio of source to noise in a beam of M microphones, and q the mean square of their
    distances from the axis of the beam, each frequency f of a frame gives the information
    2 (2 pi f / c)^2 q s^2 / (1 + s) (H. Van Trees, Optimum Array Processing (2002), section 8.4).
    """
    frequencies = np.fft.rfftfreq(SAMPLES, 1.0 / RATE)
    heard = frequencies[(BAND[0] <= frequencies) & (frequencies <= BAND[1])]
    s = ARRAY.size * 10.0 ** (decibel / 10.0)
    k = 2.0 * np.pi * heard / ARRAY.speed_of_sound
    return 1.0 / np.sum(2.0 * k**2 * 0.5 * RADIUS**2 * s**2 / (1.0 + s))


@pytest.mark.slow
@pytest.mark.parametrize('decibel', mostly_thorough([0.0, -9.0, 20.0, 10.0, -6.0], 0.0, -9.0))
def test_bearings_are_as_good_as_they_say(decibel):
    errors, variances, evidence = found(decibel)
    heard = evidence > LEAST_EVIDENCE
    assert heard.mean() > (0.99 if decibel > -9.0 else 0.6)
    nis = errors[heard] ** 2 / variances[heard]
    low, high = chi_square_bounds(1.0, 2.0 / len(nis), 1e-3)
    assert low < nis.mean() < high


@pytest.mark.slow
@pytest.mark.parametrize('decibel', first_fast([0.0, 20.0, -6.0], 1))
def test_no_unbiased_bearing_is_much_better(decibel):
    errors, _, _ = found(decibel)
    # a tapered frame has 5 % less to say, and 200 errors know their mean square to 10 %
    low, high = chi_square_bounds(1.0, 2.0 / RUNS, 1e-3)
    assert low < np.mean(errors**2) / (1.05 * least_variance(decibel)) < high
    assert abs(errors.mean()) < 3.5 * np.sqrt(least_variance(decibel) / RUNS)


@pytest.mark.slow
def test_a_clear_sound_has_no_smaller_variance_than_it_should():
    # so clear that what goes on at the ends of a frame counts for noise
    errors, variances, _ = found(40.0, runs=100)
    assert np.mean(errors**2 / variances) < 1.2
    assert np.sqrt(variances.max()) < 5e-4


def srp_phat(frame, bearings):
    """Return the bearing of the largest steered response, phases alone (J. DiBiase, 2000)."""
    frequencies = np.fft.rfftfreq(SAMPLES, 1.0 / RATE)
    heard = (BAND[0] <= frequencies) & (frequencies <= BAND[1])
    X = np.fft.rfft(frame)[:, heard].T
    steering = ARRAY.steering(frequencies[heard], bearings).conj()
    response = np.abs(np.einsum('kgm,km->kg', steering, X / np.abs(X))) ** 2
    return bearings[response.sum(axis=0).argmax()]


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize('decibel', mostly_thorough([10.0, -8.0], -8.0))
def test_it_beats_a_steered_response(decibel):
    near = np.linspace(-0.2, 0.2, 201)  # which is kind to the peer
    errors = [
        (difference(FINDER(frame).bearing, true), difference(srp_phat(frame, true + near), true))
        for true, frame in frames(decibel, runs=100)
    ]
    ours, theirs = np.mean(np.square(errors), axis=0)
    assert ours < theirs


@pytest.mark.thorough
@pytest.mark.slow
def test_noise_alone_is_no_source():
    _, _, evidence = found(-60.0, runs=500)
    assert np.all(evidence < LEAST_EVIDENCE)


@pytest.mark.thorough
@pytest.mark.slow
def test_what_is_hardly_heard_does_no_harm():
    # here most frames have no clear source; the few that pass must be as good as they say
    for decibel in (-10.0, -12.0, -14.0):
        errors, variances, evidence = found(decibel)
        heard = evidence > LEAST_EVIDENCE
        assert np.all(errors[heard] ** 2 / variances[heard] < 16.0)


@pytest.mark.slow
def test_a_source_may_be_heard_without_a_direction():
    # waves far longer than the array is wide: evidently there, and hardly from anywhere
    band = (100.0, 420.0)
    array = MicrophoneArray(0.15 * ARRAY.positions)
    finder = DirectionFinder(array, RATE, SAMPLES, band)
    errors, variances, evidence = found(0.0, finder, band=band, array=array)
    assert np.mean(evidence > LEAST_EVIDENCE) > 0.99
    assert np.sqrt(np.median(variances)) > 0.2
    low, high = chi_square_bounds(1.0, 2.0 / RUNS, 1e-3)
    assert low < np.mean(errors**2 / variances) < high


@pytest.mark.slow
def test_a_hum_is_enough():
    # most bands contain nothing of the sound
    errors, variances, evidence = found(10.0, band=(900.0, 1000.0))
    assert np.all(evidence > LEAST_EVIDENCE)
    low, high = chi_square_bounds(1.0, 2.0 / RUNS, 1e-3)
    assert low < np.mean(errors**2 / variances) < high


def test_the_evidence_is_that_of_the_formula():
    """For one band, integrated over bearings and over ratios of -10 to 59 dB, by brute force.

    A frame that fades in and out has fewer independent frequencies than it has frequencies.
    """
    band = (1000.0, 1330.0)
    finder = DirectionFinder(ARRAY, RATE, SAMPLES, band)
    frame = np.random.default_rng(7).normal(size=(6, SAMPLES))
    frame += 0.5 * np.roll(frame[:1], 3)
    place = (np.arange(SAMPLES) + 0.5) / SAMPLES
    taper = np.sin(0.5 * np.pi * np.clip(np.minimum(place, 1.0 - place) / 0.1, 0.0, 1.0)) ** 2
    frequencies = np.fft.rfftfreq(SAMPLES, 1.0 / RATE)
    inside = (band[0] <= frequencies) & (frequencies <= band[1])
    assert 32 <= inside.sum() < 64
    X = np.fft.rfft(taper * frame)[:, inside]
    bearings = 2.0 * np.pi * np.arange(720) / 720
    units = np.stack((np.cos(bearings), np.sin(bearings)), axis=-1)
    lead = units @ ARRAY.positions.T / 343.0
    phases = np.exp(2j * np.pi * frequencies[inside][:, np.newaxis, np.newaxis] * lead)
    power = np.abs(np.einsum('kgm,mk->kg', phases.conj(), X)) ** 2
    gamma = power.sum(axis=0) / (6.0 * np.sum(np.abs(X) ** 2))
    K = inside.sum() * np.mean(taper**2) ** 2 / np.mean(taper**4)
    psi = 10.0 ** (0.1 * np.arange(-10.0, 60.0, 3.0))[:, np.newaxis]
    odds = (1.0 + psi) ** -K * (1.0 - gamma * psi / (1.0 + psi)) ** (-6.0 * K)
    density = odds.mean(axis=0)
    found = finder(frame)
    assert found.evidence == pytest.approx(np.log(density.mean()), abs=1e-3)
    mean = np.angle(density @ np.exp(1j * bearings))
    assert difference(found.bearing, mean) == pytest.approx(0.0, abs=1e-3)
    variance = density @ difference(bearings, mean) ** 2 / density.sum()
    assert found.variance == pytest.approx(variance, rel=1e-3)


def test_loudness_does_not_matter_but_silence_does():
    _, frame = next(frames(10.0))
    one, other = FINDER(frame), FINDER(1e-6 * frame)
    np.testing.assert_allclose(one, other, rtol=1e-9)
    assert FINDER(np.zeros_like(frame)).evidence < LEAST_EVIDENCE
    assert not FINDER(np.full_like(frame, np.nan)).evidence > LEAST_EVIDENCE


@pytest.mark.thorough
@pytest.mark.slow
def test_an_array_of_any_shape_will_do():
    array = MicrophoneArray([0.0, 0.0, 0.15, 0.02, -0.03, 0.12, 0.1, -0.1])
    finder = DirectionFinder(array, RATE, SAMPLES, BAND)
    errors, variances, _ = found(5.0, finder, array=array)
    low, high = chi_square_bounds(1.0, 2.0 / RUNS, 1e-3)
    assert low < np.mean(errors**2 / variances) < high


@pytest.mark.parametrize(
    ('positions', 'says'),
    [
        ([0.0, 0.0, 1.0, 0.0, 2.0, 1e-6], 'not all on one line'),
        ([0.0, 0.0, 1.0, 0.0], 'three or more, all finite, got 4 numbers'),
        ([0.0, 0.0, 1.0, 1.0, 2.0, 2.0], 'not all on one line'),
        ([0.0, 0.0, 1.0, np.nan, 2.0, 2.0], 'all finite'),
        ([0.0] * 6, 'not all on one line'),
    ],
)
def test_microphones_that_cannot_tell_directions_are_refused(positions, says):
    with pytest.raises(ValueError, match=f'microphones: expected .*{says}'):
        MicrophoneArray(positions)


def test_microphones_may_be_nearly_on_a_line():
    array = MicrophoneArray([0.0, 0.0, 1.0, 0.0, 2.0, 1e-5])
    assert array.size == 3
    assert array.radius == pytest.approx(2.0)
    np.testing.assert_array_equal(array.positions, [[0.0, 0.0], [1.0, 0.0], [2.0, 1e-5]])


def test_a_band_without_frequencies_is_refused():
    with pytest.raises(ValueError, match='band: expected 32 frequencies .* got 31'):
        DirectionFinder(ARRAY, RATE, SAMPLES, (1000.0, 1300.0))
    with pytest.raises(ValueError, match='speed_of_sound: expected a positive number'):
        MicrophoneArray(circle(3, 0.1), 0.0)


def test_it_beats_another_library_in_that_ones_own_simulation():
    acoustics = pytest.importorskip('pyroomacoustics')
    rng = np.random.default_rng(5)
    errors = []
    for bearing in rng.uniform(-np.pi, np.pi, 40):
        centre = np.array([20.0, 20.0])
        # no wall reflects: the open air
        room = acoustics.ShoeBox([40.0, 40.0], fs=int(RATE), max_order=0, air_absorption=False)
        room.add_microphone_array((centre + ARRAY.positions).T)
        away = 15.0 * np.array([np.cos(bearing), np.sin(bearing)])
        room.add_source(centre + away, signal=rng.normal(size=3 * SAMPLES))
        room.simulate()
        frame = room.mic_array.signals[:, SAMPLES : 2 * SAMPLES]
        frame = frame + 1.5 * frame.std() * rng.normal(size=frame.shape)
        peer = acoustics.doa.SRP(
            ARRAY.positions.T, int(RATE), 256, c=room.c, num_src=1,
            azimuth=bearing + np.linspace(-0.3, 0.3, 301),
        )  # fmt: skip
        spectra = [acoustics.transform.stft.analysis(x, 256, 128).T for x in frame]
        peer.locate_sources(np.array(spectra), freq_range=list(BAND))
        finder = DirectionFinder(MicrophoneArray(ARRAY.positions, room.c), RATE, SAMPLES, BAND)
        arrival = finder(frame)
        error = difference(arrival.bearing, bearing)
        errors.append((error, difference(peer.azimuth_recon[0], bearing), arrival.variance))
    ours, theirs, variances = np.array(errors).T
    assert np.mean(ours**2) < np.mean(theirs**2)
    low, high = chi_square_bounds(1.0, 2.0 / len(ours), 1e-3)
    assert low < np.mean(ours**2 / variances) < high
