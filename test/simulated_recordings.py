# SPDX-License-Identifier: Apache-2.0
"""Readings of a scenario that is driven by a known input, without nodes."""

import numpy as np

import kalman_ros as kr
from kalman_ros.linear.factor import cholesky


def square_wave(time, size, period):
    """Return an input that is +size and -size in turns, with edges that do not repeat."""
    return size * np.sign(np.sin(2.0 * np.pi * time / period + 0.8 * np.sin(0.37 * time)))


def readings(scenario, time, inputs, seed, start=None):
    """Return the states (N, n) and the readings of each sensor at ``time``, by its rate."""
    scenario = kr.load(scenario)
    model, rng = scenario.model, np.random.default_rng(seed)
    dt = float(time[1] - time[0])
    x = np.array(scenario.initial_state if start is None else start, dtype=float)
    states = []
    for u in np.asarray(inputs):
        states.append(x)
        Q = model.noise_covariance(x, u, dt)
        noise = cholesky(Q + 1e-18 * np.eye(len(Q)))[0] @ rng.standard_normal(x.size)
        x = model.state.wrap(model.step(x, u, dt) + noise)
    states = np.array(states)
    times, values = {}, {}
    for name, source in scenario.enabled.items():
        every = round(1.0 / (source.timed.rate * dt))
        y = source.sensor.measure(states[::every])
        std = np.sqrt(source.sensor.covariance.diagonal())
        times[name] = time[::every]
        values[name] = y + std * rng.standard_normal(y.shape)
    return states, times, values
