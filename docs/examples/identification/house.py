# SPDX-License-Identifier: Apache-2.0
"""The heat of a test house: two temperatures, seven numbers, by maximum likelihood.

    python3 house.py armadillo_data_H2.csv

The file is data/armadillo/armadillo_data_H2.csv of https://github.com/locie/pySIP, whose page
"Armadillo real world example: frequentist fit" has the numbers that are printed beside ours. The
walls at Tw and the air at Ti exchange heat, and the heater warms the air:

    Cw dTw/dt = (Ti - Tw) / Ri + (To - Tw) / Ro + noise,    Ci dTi/dt = (Tw - Ti) / Ri + Q.

Outdoor temperature To and heating Q change linearly between samples: they are states whose slope
is the input.
"""

import sys

import numpy as np

import kalman_ros as kr

#: Estimates and deviations on the page of pySIP, with the time in days, and its log-likelihood.
PUBLISHED = {
    'Ro': (0.017593, 0.000927), 'Ri': (0.001984, 0.000075), 'Cw': (169.597112, 7.662583),
    'Ci': (18.946350, 0.771580), 'wander': (0.521344, 0.046986), 'error': (0.034325, 0.002333),
    'first': (26.594539, 0.130517),
}  # fmt: skip
LOG_LIKELIHOOD = 331.057569
#: Where the fit of that page begins.
START = {
    'Ro': 1e-2, 'Ri': 1e-3, 'Cw': 1e7 / 86400, 'Ci': 1e6 / 86400,
    'wander': 1e-3 * 86400**0.5, 'error': 1e-2, 'first': 25.0,
}  # fmt: skip


def fit(file):
    """Return the fit to the rows of the file but the last, as on that page."""
    time, outside, heating, _, inside = np.loadtxt(file, delimiter=',', skiprows=1).T[:, :-1]
    days, given = time / 86400.0, np.stack((outside, heating), axis=1)
    slopes = np.diff(given, axis=0, append=given[-1:]) / np.diff(days, append=np.inf)[:, None]

    def house(Ro, Ri, Cw, Ci, wander, error, first):
        A = np.zeros((4, 4))  # Tw, Ti, To, Q
        A[0] = [-1.0 / (Cw * Ri) - 1.0 / (Cw * Ro), 1.0 / (Cw * Ri), 1.0 / (Cw * Ro), 0.0]
        A[1] = [1.0 / (Ci * Ri), -1.0 / (Ci * Ri), 0.0, 1.0 / Ci]
        model = kr.continuous_model(A, np.eye(4)[:, 2:], W=[wander**2, 0.0, 0.0, 0.0])
        start = [first, 26.7, *given[0]], [0.01, 0.01, 0.0, 0.0]
        return model, ([0, 1, 0, 0], error**2), start

    return kr.tune(house, days, inside, slopes, fit=START, linear=['first'])


def main():
    """Print both fits."""
    found = fit(sys.argv[1])
    print(f'{"":8}{"pySIP":>20}{"kalman_ros":>24}')
    for name, (value, std) in PUBLISHED.items():
        mine = found.parameters[name]
        ours = f'{mine.value:.6g} ± {(mine.high - mine.low) / (2.0 * 1.96):.2g}'
        print(f'{name:8}{f"{value:.6g} ± {std:.2g}":>20}{ours:>24}')
    print(f'log-likelihood {LOG_LIKELIHOOD:.4f} and {found.log_likelihood[1]:.4f}')


if __name__ == '__main__':
    main()
