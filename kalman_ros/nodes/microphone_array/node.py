# SPDX-License-Identifier: Apache-2.0
"""The microphone array: sound in, simulated or recorded, and the bearing of its source out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from sensor_msgs.msg import TimeReference

from kalman_ros.acoustics import recording
from kalman_ros.acoustics.array import MicrophoneArray
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.tick import read_tick, write_tick
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Array, Value, is_due, is_finite, ratio
from kalman_ros.nodes.middleware import runtime
from kalman_ros.nodes.middleware.diagnostics import Report
from kalman_ros.nodes.middleware.topics import QUEUE, on_topic
from kalman_ros.pipeline.step_assembler import StepAssembler
from kalman_ros.pipeline.throttle import Throttle
from kalman_ros.scenario import Scenario, SensorSource
from kalman_ros.sensors.bearing import Bearing
from kalman_ros.simulation.sound import SimulatedSound, Sound

from .bearing_detector import BearingDetector
from .options import MicrophoneArrayOptions
from .playback import Playback

_TRUTH = 'ground_truth'
#: In lockstep the plant's ticks, by a remap, before a bearing is added to them.
_PLANT_TICK = 'plant_tick'


class MicrophoneArrayNode(runtime.ScenarioNode):
    """Publishes the readings of a sensor of kind bearing, from sound.

    A frame in which no source is detected, or whose direction is not clear, gives no reading;
    ``/diagnostics`` counts them.
    """

    default_model = 'bearing_tracker'

    def __init__(self) -> None:
        super().__init__('microphone_array', MicrophoneArrayOptions)

    def configure(self) -> None:
        """Build the detector and its source of sound, and create the publishers."""
        super().configure()
        options: MicrophoneArrayOptions = self.options
        self._warn = Throttle(self.get_logger().warning)
        self._sensor = _bearing(self._source)
        self._array = MicrophoneArray(np.array(options.microphones), options.speed_of_sound)
        recorded = self._recorded = None
        if options.recording:
            if options.lockstep:
                raise ValueError('lockstep: expected false, for a recording takes its own time')
            recorded = self._recorded = recording.read(Path(options.recording), self._array.size)
        rate = options.sample_rate if recorded is None else recorded.sample_rate
        signal = self._source.signal
        self._detector = BearingDetector(signal, self._array, rate, options)
        self._publisher = self.create_publisher(self._detector.message_type, signal.topic, QUEUE)
        if options.lockstep:
            self._tick_publisher = self.create_publisher(TimeReference, 'tick', QUEUE)

    def activate(self) -> None:
        """Start the recording, or the simulated source at the plant's position."""
        self._answer: Any = None
        if self._recorded is None:
            self._simulate()
            return
        interval, samples = 1.0 / self._source.timed.rate, self._detector.samples
        self._playback = Playback(
            self, self._recorded, interval, samples, self._has_subscribers, self._detect
        )

    @property
    def _source(self) -> SensorSource:
        name = self.options.bearing_sensor
        if name not in self.scenario.sensors:
            known = ', '.join(self.scenario.sensors)
            raise ValueError(f"bearing_sensor: expected a sensor among ({known}), got '{name}'")
        return self.scenario.sensors[name]

    def _has_subscribers(self) -> bool:
        return bool(self._publisher.get_subscription_count())

    def _detect(self, time: int, frame: Array) -> None:
        self._answer = self._detector(time, frame, self.options)
        self._publish()

    def _publish(self) -> None:
        if self._answer is not None:
            self._publisher.publish(self._answer)

    def _simulate(self) -> None:
        """Simulate the source at the plant's position."""
        self._start()
        truth = on_topic(self.scenario.state, _TRUTH)
        self._read_truth = WireReader(SignalCodec(truth))
        self._steps = StepAssembler({_TRUTH: _TRUTH}, answered=False)
        kind = self._read_truth.message_type
        self.create_subscription(kind, _TRUTH, self._on_truth, QUEUE, raw=True)
        if self.options.lockstep:
            self.create_subscription(TimeReference, _PLANT_TICK, self._on_tick, QUEUE, raw=True)

    def _start(self) -> None:
        options = self.options
        low, high = options.band
        sound = Sound(options.sound_level, (low, high), options.microphone_noise)
        samples, rate = self._detector.samples, options.sample_rate
        self._sound = SimulatedSound(self._array, rate, samples, sound, options.seed)
        self._first: int | None = None

    def _on_truth(self, data: bytes) -> None:
        try:
            time, x, _ = self._read_truth(data)
        except (LookupError, ValueError) as error:
            self._warn(f'{_TRUTH}: {error}')
            return
        if time is None or not is_finite(x):
            return
        if not self.options.lockstep:
            self._listen(time, x)
            return
        self._steps.reading(_TRUTH, time, x)
        self._process_steps()

    def _listen(self, time: int, x: Array) -> None:
        """Publish the bearing of the state ``x``, if a reading is due."""
        if self._first is None:
            self._first = time
        rate = self.scenario.rate
        step = round((time - self._first) * 1e-9 * rate)
        self._answer = None
        if is_due(step, ratio(self._source.timed.rate, rate)):
            self._detect(time, self._sound(self._sensor.line_of_sight(x)))

    def _on_tick(self, data: bytes) -> None:
        time, topics = read_tick(data)
        if self._steps.tick(time, [_TRUTH], kept=topics):
            self._start()
        self._process_steps()

    def _process_steps(self) -> None:
        """Forward the ticks whose truth is received, with the bearing if there is one."""
        for step in self._steps.complete():
            for _, x in step.readings:
                self._listen(step.time, x)
            if not step.readings:  # a repeated tick
                self._publish()
            topics = step.kept
            if self._answer is not None:
                topics = (*topics, self._source.signal.topic)
            self._tick_publisher.publish(write_tick(step.time, topics))

    def prepare(
        self, scenario: Scenario, options: MicrophoneArrayOptions, extra: Mapping[str, Value]
    ) -> Callable[[], None]:
        """Accept other thresholds of a bearing; they are read at every frame."""
        return lambda: None

    def report(self) -> Report:
        """Return the counts of frames, by result."""
        return self._detector.report()


def _bearing(source: SensorSource) -> Bearing:
    sensor = source.sensor
    if not isinstance(sensor, Bearing):
        raise ValueError(f'bearing_sensor: expected a sensor of kind bearing, got {sensor.name}')
    return sensor


def main() -> None:
    """Run the microphone array."""
    runtime.main(MicrophoneArrayNode)
