# SPDX-License-Identifier: Apache-2.0
"""The control law and the cost of a scenario.

Nodes that neither control nor assess control omit this part, which avoids importing
the design of gains.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import Any

from kalman_ros.control.laws import LAWS, STATE_LIMIT, WITHIN_LIMITS, law_options
from kalman_ros.core import About, Option, Space, System, semidefinite


def options(system: System, state: Space, values: Mapping[str, Any]) -> dict[str, Option]:
    """Return the options of the law chosen by ``values``, and of the cost."""
    law = Option('law', 'lqr', About(f'control law: {", ".join(LAWS)}', live=True))
    chosen = str(law.check(values.get(law.name, law.default)))
    by_name = {option.name: option for option in (law, *law_options(chosen))}
    if chosen in WITHIN_LIMITS:
        for name, unit in zip(state.names, state.units):
            about = About(f'lowest and highest {name}, at a price', unit, live=True)
            option = Option(f'{STATE_LIMIT}.{name}', [-inf, inf], about)
            by_name[option.name] = option
    else:
        _refuse_limits(chosen, values)
    weights = {
        'state_cost': (system.state_cost, 'weight of the state'),
        'input_cost': (system.input_cost, 'weight of the input'),
    }
    for name, (default, meaning) in weights.items():
        about = About(f'{meaning} in the LQR cost: the diagonal, or all rows', live=True)
        by_name[name] = Option(name, list(default), about)
    return by_name


def limits_of_states(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the limits of states among parameters."""
    return {name: v for name, v in values.items() if name.startswith(f'{STATE_LIMIT}.')}


def kept(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values without limits of states, unless the law among them keeps such limits."""
    aside = {} if values.get('law') in WITHIN_LIMITS else limits_of_states(values)
    return {name: value for name, value in values.items() if name not in aside}


def _refuse_limits(law: str, values: Mapping[str, Any]) -> None:
    """Raise ValueError if limits of states are given, which a law does not keep."""
    given = next(iter(limits_of_states(values)), None)
    if given is not None:
        keeping = ' or '.join(WITHIN_LIMITS)
        raise ValueError(f'{given}: the law {law} keeps no limits of states, choose {keeping}')


def build(values: Mapping[str, Any], n: int, m: int) -> dict[str, Any]:
    """Return the law and the cost, for a `Scenario` of ``n`` states and ``m`` inputs.

    Raises
    ------
    ValueError
        If a weight is not positive (semi-)definite.
    """
    return {
        'state_cost': semidefinite('state_cost', values['state_cost'], n),
        'input_cost': semidefinite('input_cost', values['input_cost'], m, definite=True),
        'law': values['law'],
        'law_options': {
            name: value
            for name, value in values.items()
            if name in {option.name for option in law_options(values['law'])}
        }
        | limits_of_states(values),
    }
