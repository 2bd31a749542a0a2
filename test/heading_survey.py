# SPDX-License-Identifier: Apache-2.0
"""The ANEES of inertial navigation from a heading that is wrong by 90 degrees, over many drives.

    python test/heading_survey.py [--runs 200] [--first 0] [--filters gaussian_sum ekf]

prints the ANEES with its band of 99.9 %, and the largest error of the heading. The exit code is 1
if the first filter is outside.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

if __name__ == '__main__':
    sys.path.insert(0, str(Path(__file__).parents[1]))

from kalman_ros import sensors
from kalman_ros.core import Gaussian, TimedSensor
from kalman_ros.core import rotations as so3
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.estimators.filter import Plan
from kalman_ros.models.inertial import Inertial

MODEL, STEP, STEPS = Inertial(1e-5, 1e-3, 1e-8, 1e-6), 0.05, 240
STD = np.repeat([0.5, 0.03, 0.3, 0.005, 0.05], 3)
#: Of the heading; the drive begins with it as an error.
WRONG = np.pi / 2


def first_heading():
    """Return the state (15,) that is believed at first."""
    start = np.zeros(15)
    start[5] = 0.7
    return start


def drive(seed):
    """Return the inputs and fixes of a drive, and the state at its end (15,)."""
    rng = np.random.default_rng(seed)
    space, gravity = MODEL.state, MODEL.equilibrium.input[3:]
    Q = STEP * MODEL.noise_density(np.zeros(15)).diagonal()
    first = rng.normal(size=15) * STD
    first[5] = WRONG
    x, steps = space.add(first_heading(), first), []
    for k in range(STEPS):
        t = k * STEP
        pushed = [1.5 * np.cos(0.8 * t), 0.5 * np.sin(0.5 * t), 0.0]
        rate = [0.05 * np.sin(t), 0.05 * np.cos(0.7 * t), 0.4 * np.sin(0.3 * t)]
        force = pushed + so3.rotate_back(x[3:6], gravity)
        u = np.hstack((rate + x[9:12], force + x[12:]))
        x = space.add(MODEL.step(x, u, STEP), rng.normal(size=15) * np.sqrt(Q))
        steps.append((u, x[:3] + 0.5 * rng.normal(size=3)))
    return steps, x


def scores(kind, runs, first=0):
    """Return the NEES over its dimension, and the error of the heading, of each run (N,)."""
    space = MODEL.state
    gnss = sensors.build('states', space, [0.5] * 3, {'measures': ['x', 'y', 'z']})
    gnss.name = 'gnss'
    filter = build_filter(kind, Plan(MODEL, {'gnss': TimedSensor(gnss, 5.0)}, 1.0 / STEP))
    P = np.diag(np.where(np.arange(15) == 5, WRONG, STD) ** 2)
    found = []
    for seed in range(first, first + runs):
        steps, x = drive(seed)
        belief = Gaussian(first_heading(), P)
        for k, (u, fix) in enumerate(steps):
            belief = filter.predict(belief, u, STEP)
            if k % 4 == 3:
                belief = filter.correct(belief, fix, gnss).posterior
        error = space.subtract(x, belief.mean)
        found.append((nees(error, belief.covariance) / 15.0, abs(error[5])))
    return np.array(found).T


def band(runs):
    """Return the bounds of the ANEES of a consistent filter."""
    return chi_square_bounds(1.0, 2.0 / (15 * runs), 0.001)


def main():
    """Print a line for each filter."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--runs', type=int, default=200, metavar='N')
    parser.add_argument('--first', type=int, default=0, metavar='N')
    parser.add_argument('--filters', nargs='+', default=['gaussian_sum', 'ekf'])
    options = parser.parse_args()
    low, high = band(options.runs)
    outside = []
    for kind in options.filters:
        found, headings = scores(kind, options.runs, options.first)
        outside.append(not low < found.mean() < high)
        print(
            f'{kind}: ANEES {found.mean():.3f} of {options.runs} runs, '
            f'{low:.3f} to {high:.3f} allowed; heading off by {headings.max():.2f} rad at most',
            flush=True,
        )
    sys.exit(outside[0])


if __name__ == '__main__':
    main()
