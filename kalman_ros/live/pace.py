# SPDX-License-Identifier: Apache-2.0
"""Pace of a live loop: real time, or lockstep at any speed."""

from __future__ import annotations

from dataclasses import dataclass

from .adjustments import Adjustments

#: Range of the speed of lockstep, in simulated seconds per second.
_SLOWEST, _FASTEST = 1e-3, 200.0
#: Speed after a change to lockstep, and lowest rate of readings in Hz for real time.
_SLOW, _RARE = 0.05, 0.5
#: Largest lead of the plant: in seconds of real time, and in steps.
_AHEAD, _STEPS = 0.25, 2.0


@dataclass
class Pace:
    """The pace of a loop.

    Parameters
    ----------
    lockstep
        Whether the nodes run in lockstep; otherwise they run in real time.
    paused
        Whether the plant is paused.
    speed
        Simulated seconds per second, in lockstep.
    predicted
        Whether the prediction of the next step is shown, in lockstep while paused.
    """

    lockstep: bool = False
    paused: bool = False
    speed: float = 1.0
    predicted: bool = False
    _target: float = 0.0

    @classmethod
    def usual(cls, adjustments: Adjustments) -> Pace:
        """Return the initial pace: real time, or lockstep if requested or if readings are rare.

        With rare readings, the demo of the scenario takes a minute.
        """
        if adjustments.value('plant', 'lockstep'):
            return cls(lockstep=True)
        rates = [adjustments.value('plant', f'{name}.rate') for name in adjustments.sensors]
        if max(rates, default=1.0) >= _RARE:
            return cls()
        return cls(lockstep=True, speed=min(max(1.0, adjustments.duration / 60.0), _FASTEST))

    @classmethod
    def changed(cls, *, lockstep: bool, paused: bool) -> Pace:
        """Return the pace after a change of mode by the user."""
        return cls(lockstep=lockstep, paused=paused, speed=_SLOW if lockstep else 1.0)

    def set_speed(self, speed: float) -> None:
        """Set the speed; raise ValueError if it is out of range."""
        if not _SLOWEST <= speed <= _FASTEST:
            raise ValueError(f'speed: expected {_SLOWEST:g} to {_FASTEST:g}, got {speed:g}')
        self.speed = speed

    def restart(self) -> None:
        """Restart at simulated time zero."""
        self._target, self.predicted = 0.0, False

    def target(self, elapsed: float, seconds: float, step: float) -> float | None:
        """Return the simulated time to which the plant may continue; None if it needs no command.

        Parameters
        ----------
        elapsed
            Current simulated time in seconds; negative before the first step.
        seconds
            Real time in seconds since the last call.
        step
            Duration of a step in seconds.
        """
        if not self.lockstep or self.paused:
            return None
        elapsed = max(elapsed, 0.0)  # a negative target would pause a plant that has not begun
        limit = elapsed + max(_AHEAD * self.speed, _STEPS * step)
        self._target = min(max(self._target, elapsed) + seconds * self.speed, limit)
        return self._target
