# SPDX-License-Identifier: Apache-2.0
"""Models and sensors with one mistake each."""

import numpy as np

from kalman_ros.core import Model, OperatingPoint, Sensor, Space, variances

MASS, WHEELS, GAINS = np.float64(2.0), np.int64(4), np.array([1.0, 2.0])


class Cart(Model):
    """Nothing is wrong with this one; numpy's numbers as defaults are no mistake."""

    state, input = Space(('x', 'v'), ('m', 'm/s')), Space(('u',), ('N',))

    def __init__(self, mass=MASS, wheels=WHEELS, gains=GAINS):
        self.mass, self.wheels, self.gains = mass, wheels, gains

    def derivative(self, x, u):
        return np.stack((x[..., 1], u[..., 0] / self.mass), axis=-1)

    def noise_density(self, x):
        return np.diag([0.0, 0.1])


class OneState(Cart):
    def derivative(self, x, u):
        return np.array([x[1], u[0] / self.mass])


class FirstAxis(Cart):
    """Fits two coordinates of two states, too."""

    def derivative(self, x, u):
        return np.array([x[1], -np.sin(x[0]) + u[0]])


class StackedFirst(Cart):
    def derivative(self, x, u):
        return np.stack((x[..., 1], u[..., 0]))


class Changes(Cart):
    def derivative(self, x, u):
        x[..., 0] += 1.0
        return super().derivative(x, u)


class IsComplex(Cart):
    def derivative(self, x, u):
        return np.stack((x[..., 1], np.emath.sqrt(x[..., 0] - 1.0)), axis=-1)


class NoTable(Cart):
    def __init__(self):
        raise FileNotFoundError('no table.csv')


class NoGear(Cart):
    def __init__(self, gear=1):
        super().__init__({1: 1.0}[gear])


class TuplePoint(Cart):
    equilibrium = (np.zeros(2), np.zeros(1))


class WrongPoint(Cart):
    equilibrium = OperatingPoint(np.zeros(3), np.zeros(1))


class ListPoint(Cart):
    equilibrium = OperatingPoint([0.0, 0.0], [0.0])


class Fast(Cart):
    max_step = 'fast'


class Still(Cart):
    max_step = 0.0


class NoSpace(Cart):
    state = None


class Place(Sensor):
    """Nothing is wrong with this one."""

    def __init__(self, state, noise):
        self.output = Space(('x',), ('m',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x):
        return x[..., :1]


class NotANumber(Place):
    def measure(self, x):
        return np.nan * x[..., :1]


class NoConstructor(Sensor):
    def measure(self, x):
        return x[..., :1]


class OwnConstructor(Place):
    def __init__(self):
        pass


class NoOutput(Place):
    def __init__(self, state, noise):
        pass


class Breaks(Place):
    def __init__(self, state, noise):
        raise KeyError('no such state')


class NoMeasure(Sensor):
    def __init__(self, state, noise):
        pass


class NoSensor:
    def __init__(self, state, noise):
        pass
