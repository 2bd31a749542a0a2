# SPDX-License-Identifier: Apache-2.0
"""From arrays to estimates: filter, smooth, check, draw. No ROS is needed.

    python3 docs/examples/arrays.py

A drone climbs. A barometer reads its height ten times a second, GNSS once, less often and with
gaps, and the commanded acceleration is known.
"""

import numpy as np

import kalman_ros as kr

# What moves: height and speed, driven by the acceleration that was asked for, with gusts.
model = kr.continuous_model(
    A=[[0, 1], [0, 0]],
    B=[0, 1],
    W=[0, 0.05],  # spectral density of the gusts: adds W dt to the variance of the speed
    states=['height [m]', 'speed [m/s]'],
    inputs=['acceleration [m/s^2]'],
)
# The sensors, with variances, not standard deviations.
sensors = {
    'barometer': kr.sensor([1, 0], 0.3**2, outputs=['height [m]']),
    'gnss': kr.sensor(np.eye(2), [1.0, 0.01], outputs=['height [m]', 'speed [m/s]']),
}

# A flight to have data; yours come from a file.
rng = np.random.default_rng(1)
F, G, Q, _ = kr.discretize(model, 0.1)
times = np.arange(300) * 0.1
asked = np.sin(0.4 * times)
truth = np.zeros((300, 2))
for k in range(299):
    truth[k + 1] = F @ truth[k] + G[:, 0] * asked[k] + rng.multivariate_normal([0, 0], Q)
barometer = truth[:, 0] + 0.3 * rng.normal(size=300)
barometer[100:140] = np.nan  # covered for four seconds
gnss_times = times[::10] + 1e-9
gnss = truth[::10] + rng.normal(size=(30, 2)) * [1.0, 0.1]
gnss[5, 1] = np.nan  # one reading without a speed
gnss[20] = [80.0, 0.0]  # and one outlier

estimates = kr.filter(
    model,
    sensors,
    times={'barometer': times, 'gnss': gnss_times},
    readings={'barometer': barometer, 'gnss': gnss},
    inputs=asked,
    input_times=times,
    initial=([0, 0], [1, 1]),  # mean and variances at the first time
    gates={'gnss': 0.9999},  # a good reading passes with this probability
)
smooth = kr.smooth(estimates)
print(estimates)

# The true height at the times of the estimates, to see what smoothing is worth.
height = np.interp(estimates.time, times, truth[:, 0])
for name, found in (('filtered', estimates), ('smoothed', smooth)):
    rms = np.sqrt(np.mean((found.mean[:, 0] - height) ** 2))
    print(f'{name}: RMS error of the height {rms:.3f} m')

# FAIL, for GNSS: that one reading, which the gate rejected, is no noise that the sensor admits.
print(kr.consistency(estimates))
smooth.plot('smoothed.png')
