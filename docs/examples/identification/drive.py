# SPDX-License-Identifier: Apache-2.0
"""A linear drive: its mass and its friction, by maximum likelihood.

    python3 drive.py DATA_EMPS.mat

The file is that of the benchmark EMPS (https://www.nonlinearbenchmark.org), an axis of a robot
with a ball screw; also examples/EMPS/data in https://github.com/forgi86/sysid-neural-continuous.
Printed beside ours are the estimates of A. Janot, M. Gautier and M. Brunot, Data Set and Reference
Models of EMPS (Workshop on Nonlinear System Identification Benchmarks, 2019), section 3.4: least
squares on filtered and differentiated positions. The model is theirs,

    M dv/dt = F - Fv v - Fc sign(v) - offset + noise,

with a sign that changes within some mm/s. Nothing is differentiated: speeds are states.
"""

import sys

import numpy as np
from scipy.io import loadmat

import kalman_ros as kr

#: Estimates and deviations of the paper, in kg, N s/m and N.
PUBLISHED = {
    'M': (95.1089, 0.1085), 'Fv': (203.5034, 1.1460), 'Fc': (20.3935, 0.1012),
    'offset': (-3.1648, 0.0444),
}  # fmt: skip
#: Samples that are taken together, of 1 ms, and the speed at which the sign is nearly reached.
EVERY, SLOW = 5, 1e-3
#: Deviation of the position: the steps of its encoder.
STEP = 5e-8


def fit(file):
    """Return the fit to a file of the benchmark."""
    data = loadmat(file)
    position, volts = (data[name].ravel() for name in ('qm', 'vir'))
    count = len(position) // EVERY
    force = float(data['gtau'].item()) * volts[: count * EVERY].reshape(count, EVERY).mean(axis=1)
    times, readings = 1e-3 * EVERY * np.arange(count), position[: count * EVERY : EVERY]

    def drive(M=60.0, Fv=100.0, Fc=10.0, offset=0.0, push=3.0):
        def rate(x, u):
            v = x[1]
            return np.array([v, (u[0] - Fv * v - Fc * np.tanh(v / SLOW) - offset) / M])

        noise = [0.0, (push / M) ** 2]
        model = kr.continuous_model(rate, W=noise, states=['q', 'v'], inputs=['F'], max_step=1e-3)
        return model, ([1, 0], STEP**2), ([readings[0], 0.0], [STEP**2, 1e-8])

    return kr.tune(drive, times, readings, force, linear=['offset'])


def main():
    """Print both fits."""
    found = fit(sys.argv[1])
    print(f'{"":8}{"Janot et al.":>20}{"kalman_ros":>24}')
    for name, (value, std) in PUBLISHED.items():
        mine = found.parameters[name]
        ours = f'{mine.value:.6g} ± {(mine.high - mine.low) / (2.0 * 1.96):.2g}'
        print(f'{name:8}{f"{value:.6g} ± {std:.2g}":>20}{ours:>24}')


if __name__ == '__main__':
    main()
