# SPDX-License-Identifier: Apache-2.0
"""Real nodes from a script: the same scenario over topics and in this process.

    source install/setup.bash
    python3 docs/examples/nodes.py

Needs ROS 2 and the built package. The nodes run as processes in lockstep, faster than real time;
nothing is left running.
"""

import numpy as np

import kalman_ros as kr

LOOP = {'law': 'lqi', 'tracked': ['x'], 'input_limit': [20.0]}

# The plant, the estimator, the controller and the monitor, each a separate process.
with kr.Run('cart_pole', LOOP, seed=1) as nodes:
    nodes.advance(1.0)  # simulated seconds
    first = nodes.trajectory()
    nodes.set_parameter('state_cost', [500.0, 0.0, 100.0, 0.0], node='controller')
    nodes.advance(1.0)
    whole = nodes.trajectory()  # arrays, joined by their stamps

print(f'{len(whole.time)} steps, a force of {np.abs(whole.input).max():.1f} N at most')

# Without topics: the same plant, the same filter, the same regulator.
alone = kr.simulate('cart_pole', LOOP, seconds=1.0, seed=1)
difference = np.abs(first.truth - alone.truth).max()
print(f'over topics and without them the cart-pole moves the same, to {difference:.1g}')
alone.plot('cart_pole.png')
