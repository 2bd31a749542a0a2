# SPDX-License-Identifier: Apache-2.0
"""The basic types: spaces, beliefs, models, sensors and options."""

from kalman_ros.linear.discretize import Discretization, van_loan, zero_order_hold
from kalman_ros.linear.errors import DesignError
from kalman_ros.linear.matrices import (
    Array,
    ArrayLike,
    check_real,
    identity,
    is_finite,
    matrix,
    one_each,
    semidefinite,
    solve,
    spectral_densities,
    symmetric,
    variances,
    vector,
)
from kalman_ros.linear.views import coordinates, from_coordinates

from .discrete_model import DiscreteLinearSystem, DiscreteModel, check_period, check_rate
from .dynamics import Dynamics, LinearizedStep, OperatingPoint, Transition
from .gaussian import Definite, Gaussian, chosen, definite, unchecked
from .linear_system import LinearSystem, linearize
from .model import Model, in_continuous_time, numerical_jacobian
from .named_options import About, Option, Value, brief, build_with, options_of, refuse_unknown
from .registry import find
from .sensor import Hypotheses, Sensor
from .space import Space
from .system import SensorSetup, Signal, System
from .timing import TimedSensor, following, is_due, period, ratio

__all__ = [
    'About',
    'Array',
    'ArrayLike',
    'Definite',
    'DesignError',
    'DiscreteLinearSystem',
    'DiscreteModel',
    'Discretization',
    'Dynamics',
    'Gaussian',
    'Hypotheses',
    'LinearSystem',
    'LinearizedStep',
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
    'brief',
    'build_with',
    'check_period',
    'check_rate',
    'check_real',
    'chosen',
    'coordinates',
    'definite',
    'find',
    'following',
    'from_coordinates',
    'identity',
    'in_continuous_time',
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
    'spectral_densities',
    'symmetric',
    'unchecked',
    'van_loan',
    'variances',
    'vector',
    'zero_order_hold',
]
