# SPDX-License-Identifier: Apache-2.0
"""Readers of messages: of readings with their covariances, and of inputs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import isfinite
from typing import Any

import numpy as np

from kalman_ros.codecs.covariances import AbsentError
from kalman_ros.codecs.fixes import NoFixError
from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.messages import FRAME_START, leading_stamp
from kalman_ros.codecs.signal_codecs import codec_of
from kalman_ros.codecs.wire import Samples, WireReader
from kalman_ros.core import Array, Signal, is_finite
from kalman_ros.core.geodesy import Origin
from kalman_ros.estimators.consistency import ChiSquareWindow
from kalman_ros.estimators.filter import Correction
from kalman_ros.estimators.online import is_covariance
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.linear.single import is_definite
from kalman_ros.scenario import SensorSource

from .frame_guard import FrameGuard
from .input_messages import InputDecoder
from .mounts import Mounts
from .pose_changes import FirstPoseError, PoseChange, whole_pose
from .reading import Reading, Readings
from .still_watch import StillWatch


class ReadingReader:
    """Decoder of the messages of one sensor.

    Parameters
    ----------
    signal
        Signal of the sensor.
    origin
        Datum that several receivers share; None for the datum of the signal.
    frames
        Frames of the estimate: of positions, and of the body.
    warn
        Function that is called with a sentence about a frame that was not declared.
    name
        Name of the sensor.
    """

    def __init__(
        self,
        signal: Signal,
        origin: Origin | None = None,
        frames: Sequence[str] = (),
        warn: Callable[[str], object] = str,
        name: str = '',
    ) -> None:
        self._name = name
        self._zero = np.zeros(len(signal.fields)) if signal.zero else None
        self._still = None if signal.still is None else StillWatch(signal, signal.still)
        self._change = None if signal.pose == 'absolute' else PoseChange(signal)
        read = signal if self._change is None else whole_pose(signal)
        self._read, self._origin = WireReader(codec_of(read, origin=origin)), origin
        self.message_type = self._read.message_type
        self._guard = FrameGuard(signal, self.message_type, frames, warn)
        self._offset = _stamp_offset(signal, self.message_type)
        #: Reason why the last unreadable message was refused; '' before the first.
        self.trouble = ''
        #: Covariance of the last message, its sensor, and the covariance used in its place.
        self._used: tuple[Array | None, SensorSource | None, Array | None] = (None, None, None)

    def read(self, data: bytes, source: SensorSource) -> Reading:
        """Return the reading in a message.

        Raises
        ------
        UndecodableError
            If the bytes are not those of such a message.
        """
        reading = self._decoded(data, source)
        if self._origin is not None and self._origin.is_new:
            self._origin.settle(good=_is_usable(reading))
        # a stamp of zero means that there is no stamp
        if self._offset and reading.time:
            reading.time += self._offset
        return reading

    def read_all(self, messages: Sequence[bytes], source: SensorSource) -> Readings | None:
        """Return the readings in many messages at once, as calls for each; None if not possible.

        It is possible where no message is refused, and none depends on an earlier one.
        """
        depends = self._still is not None or self._change is not None or self._settles
        if depends or not messages[0].startswith(self._guard.accepted, FRAME_START):
            return None
        samples = self._read.read_all(messages)
        if samples is None:
            return None
        time, values, carried, which = samples
        count, R = len(values), source.sensor.covariance
        if self._offset:
            time = np.where(time, time + self._offset, 0)
        if self._zero is not None:
            values, carried = np.broadcast_to(self._zero, (count, len(self._zero))), ()
            which = np.zeros(count, dtype=int)
        matrices = [source.used(C) for C in carried] or [None]
        if not all(C is None or is_covariance(C, len(R)) for C in matrices):
            return None
        completed = [C is not None and C is not given for C, given in zip(matrices, carried)]
        return Readings(
            time,
            values,
            np.array([R if C is None else C for C in matrices])[which],
            np.array(completed or [False])[which],
        )

    def _decoded(self, data: bytes, source: SensorSource) -> Reading:
        """Return the reading in a message, with the stamp of the message."""
        try:
            time, values, covariance = self._read(data)
        except NoFixError as error:
            return self.refused(leading_stamp(data), Outcome.NO_FIX, error)
        except AbsentError as error:
            return self.refused(leading_stamp(data), Outcome.ABSENT, error)
        except (LookupError, ValueError) as error:
            return self.refused(None, Outcome.WRONG_SIZE, error)
        if not data.startswith(self._guard.accepted, FRAME_START):
            other = self._guard(data)
            if other:
                return self.refused(time, Outcome.OTHER_FRAME, other)
        if self._change is not None:
            try:
                time, values, covariance = self._change(Sample(time, values, covariance))
            except FirstPoseError as error:
                return self.refused(time, Outcome.FIRST_POSE, error)
        moving = '' if self._still is None else self._still(data, time)
        if moving:
            return self.refused(time, Outcome.MOVING, moving)
        if self._zero is not None:
            return Reading(self._name, time, self._zero)
        used = self._covariance_used(covariance, source)
        completed = used is not covariance and used is not None
        return Reading(self._name, time, values, used, completed=completed)

    def _covariance_used(self, received: Array | None, source: SensorSource) -> Array | None:
        """Return the covariance to use in place of that of a message; the last one is cached."""
        last, of, used = self._used
        if received is not last or source is not of:
            used = source.used(received)
            self._used = received, source, used
        return used

    @property
    def _settles(self) -> bool:
        return self._origin is not None and self._origin.is_new

    @property
    def is_new(self) -> bool:
        """Whether a message may still decide about the datum of others, or about the frame."""
        framed = self._guard.frame or not self._guard.accepted
        return not framed or self._settles

    @property
    def frame(self) -> str:
        """The frame of the messages; '' before the first that names one."""
        return self._guard.frame

    def refused(self, time: int | None, outcome: Outcome, why: object) -> Reading:
        """Return a reading that cannot be used, and keep the reason."""
        self.trouble = str(why)
        return Reading(self._name, time, np.empty(0), None, outcome)


def _is_usable(reading: Reading) -> bool:
    """Return whether an estimator can use a reading: the first such fix is the datum."""
    R = reading.covariance
    sound = R is None or (is_finite(R) and is_definite(R))
    return reading.outcome is None and is_finite(reading.values) and sound


class UnusableInputError(ValueError):
    """Error of an input that is in another frame than declared, or in one without a transform.

    Parameters
    ----------
    outcome
        What it is counted as.
    reason
        One line.
    """

    def __init__(self, outcome: Outcome, reason: str) -> None:
        super().__init__(reason)
        self.outcome = outcome


def _stamp_offset(signal: Signal, message_type: Any) -> int:
    """Return what is added to the stamps of a signal, in nanoseconds.

    Raises
    ------
    ValueError
        If its messages have none.
    """
    if signal.stamp_offset and not hasattr(message_type, 'header'):
        why = f'expected messages with a stamp, {signal.type} has none'
        raise ValueError(f"signal '{signal.topic}': stamp_offset: {why}")
    return signal.stamp_offset


class InputReader:
    """Reader of the known input.

    Parameters
    ----------
    signal
        Signal of the input.
    frames, warn
        As for `ReadingReader`. Without a declared frame any frame is accepted, as each controller
            may name its own.
    """

    #: The input is not a sensor.
    name: None = None

    def __init__(
        self,
        signal: Signal,
        frames: Sequence[str] = (),
        warn: Callable[[str], object] = str,
        mounts: Mounts | None = None,
    ) -> None:
        self._signal, self._read = signal, InputDecoder(signal)
        #: Mounting of the sensor whose readings are the input, until its place is known.
        self._mounts = mounts if signal.mounting.from_tf else None
        self.message_type: Any = self._read.message_type
        self._guard = FrameGuard(
            signal, self.message_type, frames, lambda why: warn(f'input: {why}')
        )
        self._declared = bool(signal.mounting.frame)
        self._offset = _stamp_offset(signal, self.message_type)

    def read(self, data: bytes) -> Sample:
        """Return the input in a message.

        Raises
        ------
        UnusableInputError
            If it is in another frame than declared, or in one without a transform.
        UndecodableError, LookupError, ValueError
            If the bytes are not those of such a message, or the input is not in it.
        """
        sample = self._read.read(data)
        # a stamp of zero means that there is no stamp
        if self._offset and sample.time:
            sample = sample._replace(time=sample.time + self._offset)
        if not data.startswith(self._guard.accepted, FRAME_START):
            other = self._guard(data)
            if other and self._declared:
                raise UnusableInputError(Outcome.OTHER_FRAME, other)
        if self._mounts is None:
            return self._read.moved(sample)
        try:
            signal = self._mounts.mount_input(self._guard.frame)
        except ValueError as error:
            raise UnusableInputError(Outcome.NO_TRANSFORM, str(error)) from None
        self._signal, self._read, self._mounts = signal, InputDecoder(signal), None
        return self.read(data)

    def read_all(self, messages: Sequence[bytes]) -> Samples | None:
        """Return the inputs in many messages at once; None where `read` has to decide for each."""
        if not messages[0].startswith(self._guard.accepted, FRAME_START):
            return None
        samples = self._read.read_all(messages) if self._mounts is None else None
        if samples is None or not self._offset:
            return samples
        return samples._replace(time=np.where(samples.time, samples.time + self._offset, 0))

    def configure(self, signal: Signal) -> None:
        """Use the scale of a signal that was changed live; its names are the same."""
        before, scale = self._signal.mounting, signal.mounting.scale
        if scale != before.scale:
            self._signal = replace(self._signal, mounting=before._replace(scale=scale))
            self._read = InputDecoder(self._signal)


class SensorReader:
    """Reader of a sensor's messages, with a test whether its innovations scatter as expected."""

    def __init__(
        self,
        name: str,
        source: SensorSource,
        origin: Origin | None = None,
        frames: Sequence[str] = (),
        warn: Callable[[str], object] = str,
        mounts: Mounts | None = None,
    ) -> None:
        self.name = name
        self._build: Callable[[Signal], ReadingReader] = partial(
            ReadingReader,
            origin=origin,
            frames=frames,
            warn=lambda why: warn(f'{name}: {why}'),
            name=name,
        )
        self._read = self._build(source.signal)
        #: Mounting of the sensor, as long as its place is not known.
        self._mounts = mounts if source.signal.mounting.from_tf else None
        self.message_type: Any = self._read.message_type
        self.nis = ChiSquareWindow(source.sensor.output.size)
        self._judged = source.judged

    def reset_statistics(self) -> None:
        """Restart the statistics of the innovations."""
        self.nis = ChiSquareWindow(self.nis.degrees)

    def read(self, data: bytes, source: SensorSource) -> Reading:
        """Return the reading in a message; UndecodableError if it is not of the type."""
        if self._mounts is not None:
            reading = self._read.read(data, source)
            if reading.outcome is not None:
                return reading
            try:
                source = self._mounts.mount(self.name, self._read.frame)
                self._read = self._build(source.signal)
            except ValueError as error:
                return self._read.refused(reading.time, Outcome.NO_TRANSFORM, error)
            self._mounts = None
        return self._read.read(data, source)

    @property
    def is_settled(self) -> bool:
        """Whether its messages decide about nothing but its readings."""
        return self._mounts is None and not self._read.is_new

    def read_all(self, messages: Sequence[bytes], source: SensorSource) -> Readings | None:
        """Return the readings in many messages at once; None if that is not possible."""
        return self._read.read_all(messages, source) if self._mounts is None else None

    @property
    def trouble(self) -> str:
        """Reason why the last unreadable message was refused: the field and the sizes."""
        return self._read.trouble

    def judge(self, correction: Correction) -> None:
        """Record a correction, to test whether innovations scatter as expected."""
        if self._judged and isfinite(correction.nis):
            self.nis.add(correction.nis)
