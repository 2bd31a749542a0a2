# SPDX-License-Identifier: Apache-2.0
"""Design a regulator, see its margins, then see it at work. No ROS is needed.

    python3 docs/examples/design.py

An inverted pendulum, turned by a torque at its pivot. First the matrices, as in a textbook; then
the whole loop, with an encoder, an estimator and a motor that gives only so much.
"""

import numpy as np

import kalman_ros as kr


def pendulum(x, u):
    """Return dx/dt: angle from upright and its rate, and the torque."""
    angle, rate = x
    return [rate, 9.81 / 0.5 * np.sin(angle) - 0.2 * rate + 4.0 * u[0]]


model = kr.continuous_model(
    pendulum,
    W=[0, 0.01],
    states=['angle [rad]', 'rate [rad/s]'],
    inputs=['torque [N m]'],
    angles=['angle'],
)

# A gain for a torque that is held for 20 ms, about the equilibrium: upright.
gain = kr.lqr(model, Q=[100, 1], R=1, dt=0.02)
print(gain)
print(f'poles: {gain.poles}, phase margin {np.degrees(gain.margins[0].lag.value):.1f} deg')

# What the encoder costs: with an estimate in place of the state, the margins are smaller.
scenario = kr.make_scenario(
    model,
    sensors={'encoder': kr.sensor(lambda x: x[0], 0.01**2, outputs=['angle [rad]'])},
    rate=50,
    initial=([0, 0], [0.1, 0.1]),
    initial_state=[0.25, 0],
    Q=[100, 1],
    R=1,
)
design = kr.design(scenario)
print(design)

# The loop itself, with a motor that gives 3 N m at most.
run = kr.simulate(scenario, seconds=6, seed=3, input_limit=3.0)
print(run)
print(kr.consistency(run))
run.plot('pendulum.png')
design.plot('margins.png')
