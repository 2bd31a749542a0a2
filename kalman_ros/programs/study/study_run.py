# SPDX-License-Identifier: Apache-2.0
"""The runs of a study, which its picture names: models, filters, seeds and durations."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from kalman_ros import models
from kalman_ros.harness import Run
from kalman_ros.simulation.trajectory import Trajectory


class Ran(NamedTuple):
    """Description of a run; ``filter`` is '' without an estimator, ``seconds`` are simulated."""

    model: str
    filter: str
    seed: int
    seconds: float


_done: list[Ran] = []


#: The nodes of a study, without the monitor.
_NODES = ('estimator', 'controller', 'plant')
#: Names of topics with which the controller knows the true state.
ON_TRUTH = {'controller': {'estimate': 'ground_truth'}}


class StudyRun(Run):
    """A `Run` that is remembered when it ends."""

    def __init__(
        self,
        scenario: str | Mapping[str, Any],
        overrides: Mapping[str, Any] | None = None,
        *,
        seed: int = 0,
        **options: Any,
    ) -> None:
        super().__init__(scenario, overrides, seed=seed, **{'nodes': _NODES, **options})
        values = {'model': scenario} if isinstance(scenario, str) else scenario
        self._model = str({**values, **(overrides or {})}.get('model', models.DEFAULT))
        self._seed = seed

    def close(self) -> None:
        """Stop every node."""
        super().close()
        if self.elapsed > 0.0:
            filter = self.scenario.filter if 'estimator' in self.names else ''
            _done.append(Ran(self._model.rpartition(':')[2], filter, self._seed, self.elapsed))


def ran(system: Mapping[str, Any], seconds: float, **options: Any) -> Trajectory:
    """Return what a run of a system over topics records in these simulated seconds."""
    with StudyRun(system, **options) as run:
        run.advance(seconds)
        return run.trajectory()


def taken() -> list[Ran]:
    """Return the runs since the last call."""
    runs = _done[:]
    _done.clear()
    return runs


def described(runs: Iterable[Ran]) -> str:
    """Describe the runs in a line: models, filters, seeds, number and durations; '' for none."""
    ran = list(runs)
    if not ran:
        return ''
    filters, seeds = {r.filter for r in ran} - {''}, {str(r.seed) for r in ran}
    shortest, longest = (f'{f(r.seconds for r in ran):.4g}' for f in (min, max))
    span = longest if shortest == longest else f'{shortest} to {longest}'
    parts = [', '.join(sorted({r.model for r in ran}))]
    if filters:
        parts.append(f'filter {" and ".join(sorted(filters))}')
    parts.append(f'seed {" and ".join(sorted(seeds))}')
    parts.append(f'{len(ran)} runs of {span} s' if len(ran) > 1 else f'{span} s')
    return ', '.join(parts)
