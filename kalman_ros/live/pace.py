# SPDX-License-Identifier: Apache-2.0
"""How the time of a live loop passes: in real time, or in lockstep at any speed."""

from __future__ import annotations

from dataclasses import dataclass

from .adjustments import Adjustments

#: Simulated seconds a second, in lockstep.
_SLOWEST, _FASTEST = 1e-3, 200.0
#: The speed of a change to lockstep, and the lowest rate in Hz of readings for real time.
_SLOW, _RARE = 0.05, 0.5
#: The plant is ahead by at most these seconds of a person, and steps.
_AHEAD, _STEPS = 0.25, 2.0


@dataclass
class Pace:
    """The pace of a loop.

    Parameters
    ----------
    lockstep
        Whether the nodes step in turns; else they run in real time.
    paused
        Whether the plant waits.
    speed
        In lockstep: simulated seconds a second.
    predicted
        In lockstep, paused: whether the prediction of the next step is shown.
    """

    lockstep: bool = False
    paused: bool = False
    speed: float = 1.0
    predicted: bool = False
    _target: float = 0.0

    @classmethod
    def usual(cls, adjustments: Adjustments) -> Pace:
        """Return real time; lockstep if asked for, and a minute of it for rare readings."""
        if adjustments.value('plant', 'lockstep'):
            return cls(lockstep=True)
        rates = [adjustments.value('plant', f'{name}.rate') for name in adjustments.sensors]
        if max(rates, default=1.0) >= _RARE:
            return cls()
        return cls(lockstep=True, speed=min(max(1.0, adjustments.duration / 60.0), _FASTEST))

    @classmethod
    def changed(cls, *, lockstep: bool, paused: bool) -> Pace:
        """Return the pace after a change of mode by a person."""
        return cls(lockstep=lockstep, paused=paused, speed=_SLOW if lockstep else 1.0)

    def set_speed(self, speed: float) -> None:
        """Set the speed; ValueError if it is out of range."""
        if not _SLOWEST <= speed <= _FASTEST:
            raise ValueError(f'speed: expected {_SLOWEST:g} to {_FASTEST:g}, got {speed:g}')
        self.speed = speed

    def restart(self) -> None:
        """Start from time zero."""
        self._target, self.predicted = 0.0, False

    def target(self, elapsed: float, seconds: float, step: float) -> float | None:
        """Return the simulated time to go to; None if the plant needs no such command.

        Parameters
        ----------
        elapsed
            The simulated time.
        seconds
            Since the last call.
        step
            The length of a step.
        """
        if not self.lockstep or self.paused:
            return None
        most = elapsed + max(_AHEAD * self.speed, _STEPS * step)
        self._target = min(max(self._target, elapsed) + seconds * self.speed, most)
        return self._target
