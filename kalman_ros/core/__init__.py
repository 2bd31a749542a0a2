# SPDX-License-Identifier: Apache-2.0
"""The types that everything else is written in."""

from kalman_ros.linear.arrays import (
    Array,
    ArrayLike,
    identity,
    is_finite,
    matrix,
    one_each,
    semidefinite,
    solve,
    symmetric,
    variances,
    vector,
)
from kalman_ros.linear.discretize import Discretization, van_loan, zero_order_hold
from kalman_ros.linear.errors import DesignError

from .discrete_model import DiscreteLinearSystem, DiscreteModel
from .gaussian import Gaussian, unchecked
from .linear_system import LinearSystem, linearize
from .model import Model, OperatingPoint, Transition, numerical_jacobian
from .options import (
    About,
    Option,
    Value,
    build_with,
    options_of,
    refuse_unknown,
)
from .registry import find
from .sensor import Sensor
from .space import Space
from .system import SensorSetup, Signal, System
from .timing import TimedSensor, is_due, period, ratio

__all__ = [
    'About',
    'Array',
    'ArrayLike',
    'DesignError',
    'DiscreteLinearSystem',
    'DiscreteModel',
    'Discretization',
    'Gaussian',
    'LinearSystem',
    'Model',
    'OperatingPoint',
    'Option',
    'Sensor',
    'SensorSetup',
    'Signal',
    'Space',
    'System',
    'TimedSensor',
    'Transition',
    'Value',
    'build_with',
    'find',
    'identity',
    'is_due',
    'is_finite',
    'linearize',
    'matrix',
    'numerical_jacobian',
    'one_each',
    'options_of',
    'period',
    'ratio',
    'refuse_unknown',
    'semidefinite',
    'solve',
    'symmetric',
    'unchecked',
    'van_loan',
    'variances',
    'vector',
    'zero_order_hold',
]
