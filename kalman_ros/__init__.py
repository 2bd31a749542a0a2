# SPDX-License-Identifier: Apache-2.0
"""State estimation and optimal control for ROS 2: any model, any topic.

``import kalman_ros as kr`` offers the names below to notebooks and scripts; no ROS is needed for
any but `Run` and `replay`. Names load lazily, so the import itself takes no time.

- gains: `lqr`, `dlqr`, `lqe`, `dlqe`, `place`, `margins`, `discretize`; `mpc` keeps limits,
  `loop_shaping` is robust
- models and sensors: `continuous_model`, `discrete_model`, `sensor`, or subclasses of `Model`,
  `DiscreteModel`, `Sensor`; `Space` names coordinates; `trim` finds an `OperatingPoint`, where
  `linearize` gives the linear system
- estimation: `filter`, `smooth`, `consistency`, `Gaussian`; `tune`, or `fit`, fits parameters
- a loop of your own: `KalmanFilter`, `ExtendedKalmanFilter`, `UnscentedKalmanFilter`,
  `OnlineEstimator`, `Regulator`, `Correction`; `compile` makes a model fast
- whole loops: `make_scenario`, `load`, `design`, `worst_case`, `simulate`, `monte_carlo` for many
  runs at once, and `Run`, on the real nodes; `motion` follows a path, `export` writes C
- recordings: `replay`
"""

from importlib import import_module as _import
from typing import TYPE_CHECKING

__version__ = '0.1.0'

if TYPE_CHECKING:
    from .arrays.checking import consistency as consistency
    from .arrays.designing import design as design
    from .arrays.exporting import export as export
    from .arrays.filtering import filter as filter
    from .arrays.filtering import smooth as smooth
    from .arrays.fitting import fit as fit
    from .arrays.fitting import tune as tune
    from .arrays.gains import discretize as discretize
    from .arrays.gains import dlqr as dlqr
    from .arrays.gains import lqr as lqr
    from .arrays.gains import margins as margins
    from .arrays.gains import place as place
    from .arrays.loop_shaping import loop_shaping as loop_shaping
    from .arrays.many_runs import monte_carlo as monte_carlo
    from .arrays.moving import motion as motion
    from .arrays.observers import dlqe as dlqe
    from .arrays.observers import lqe as lqe
    from .arrays.own_loop import OnlineEstimator as OnlineEstimator
    from .arrays.own_loop import Regulator as Regulator
    from .arrays.predictive import mpc as mpc
    from .arrays.problems import compile as compile
    from .arrays.problems import continuous_model as continuous_model
    from .arrays.problems import discrete_model as discrete_model
    from .arrays.problems import sensor as sensor
    from .arrays.scenarios import load as load
    from .arrays.scenarios import make_scenario as make_scenario
    from .arrays.simulating import simulate as simulate
    from .arrays.stepwise import ExtendedKalmanFilter as ExtendedKalmanFilter
    from .arrays.stepwise import KalmanFilter as KalmanFilter
    from .arrays.stepwise import UnscentedKalmanFilter as UnscentedKalmanFilter
    from .arrays.trimming import linearize as linearize
    from .arrays.trimming import trim as trim
    from .arrays.worst_case import worst_case as worst_case
    from .bags.replay import replay as replay
    from .core import DesignError as DesignError
    from .core import DiscreteModel as DiscreteModel
    from .core import Gaussian as Gaussian
    from .core import Model as Model
    from .core import OperatingPoint as OperatingPoint
    from .core import Sensor as Sensor
    from .core import Space as Space
    from .estimators.filter import Correction as Correction
    from .harness import Run as Run

#: The module of each name; a test compares this list with the one above.
_WHERE = {
    'arrays.checking': ('consistency',),
    'arrays.designing': ('design',),
    'arrays.exporting': ('export',),
    'arrays.filtering': ('filter', 'smooth'),
    'arrays.fitting': ('fit', 'tune'),
    'arrays.gains': ('discretize', 'dlqr', 'lqr', 'margins', 'place'),
    'arrays.loop_shaping': ('loop_shaping',),
    'arrays.many_runs': ('monte_carlo',),
    'arrays.moving': ('motion',),
    'arrays.observers': ('dlqe', 'lqe'),
    'arrays.own_loop': ('OnlineEstimator', 'Regulator'),
    'arrays.predictive': ('mpc',),
    'arrays.problems': ('compile', 'continuous_model', 'discrete_model', 'sensor'),
    'arrays.scenarios': ('load', 'make_scenario'),
    'arrays.simulating': ('simulate',),
    'arrays.stepwise': ('ExtendedKalmanFilter', 'KalmanFilter', 'UnscentedKalmanFilter'),
    'arrays.trimming': ('linearize', 'trim'),
    'arrays.worst_case': ('worst_case',),
    'bags.replay': ('replay',),
    'core': (
        'DesignError',
        'DiscreteModel',
        'Gaussian',
        'Model',
        'OperatingPoint',
        'Sensor',
        'Space',
    ),
    'estimators.filter': ('Correction',),
    'harness': ('Run',),
}
_MODULES = {name: module for module, names in _WHERE.items() for name in names}
__all__ = sorted(_MODULES)


def __getattr__(name: str) -> object:
    """Load a name at its first use (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'{_hint(name)}")
    try:
        attribute = getattr(_import(f'.{_MODULES[name]}', __name__), name)
    except ModuleNotFoundError as error:
        if name not in ('Run', 'replay'):
            raise
        raise ImportError(
            f'kalman_ros.{name} needs ROS 2, and there is no {error.name}: source the setup.bash '
            'of ROS 2 and of your workspace, then start Python again'
        ) from error
    globals()[name] = attribute
    return attribute


#: How alike a name must be to be taken for a misspelt one.
_NEAR = 0.7


def _hint(name: str) -> str:
    from difflib import get_close_matches

    names = _import('.elsewhere', __name__)
    ours = next((to for of, to in names.ELSEWHERE.items() if of.lower() == name.lower()), '')
    if ours:
        return f"; did you mean '{ours}'?" if ours in _MODULES else f'; here it is {ours}'
    if name in names.ABSENT:
        library = names.ABSENT[name]
        taken = f': {library} has it, and systems and arrays of others are taken here'
        return taken if library else ', nor a counterpart of it'
    same = [known for known in __all__ if known.lower() == name.lower()]
    near = same or get_close_matches(name, __all__, n=1, cutoff=_NEAR)
    known = '' if name.startswith('_') else '; dir(kr) lists its names'
    return f"; did you mean '{near[0]}'?" if near else known


def __dir__() -> list[str]:
    return [*__all__, *(name for name in globals() if name.startswith('__'))]
