# SPDX-License-Identifier: Apache-2.0
"""A server for Foxglove, Lichtblick and PlotJuggler: topics as they are, and parameters."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from math import isfinite
from secrets import randbelow
from typing import Any, Protocol

import foxglove
from foxglove.websocket import (
    Capability,
    ChannelView,
    Parameter,
    PlaybackCommand,
    PlaybackControlRequest,
    PlaybackState,
    PlaybackStatus,
    ServerListener,
    StatusLevel,
)

from kalman_ros.bags.definitions import definition

from .bag_player import BagPlayer, Position
from .viewer_gate import ViewerGate
from .web_access import Access


class Parameters(Protocol):
    """What a viewer reads and changes; values are those of ROS parameters."""

    def read(self, names: Sequence[str]) -> Mapping[str, Any]:
        """Return the values of parameters that exist; of all for no names."""
        ...

    def change(self, values: Mapping[str, Any]) -> str:
        """Change parameters; return why some are refused, '' if none is."""
        ...


class ViewerServer:
    """Serves topics and parameters to viewers, in separate threads; a context manager.

    The protocol is that of foxglove-sdk, which admits everybody who can reach it. So its server
    listens on an address of the loopback network and a port that are random and known to nobody
    but a `ViewerGate`, which admits viewers.

    Parameters
    ----------
    name
        Shown in the viewer.
    access, pages, on_refusal
        As for the gate.
    parameters
        What viewers read and change; called by any thread. None offers none.
    player
        Of a recording, which viewers control.
    """

    def __init__(
        self,
        name: str,
        access: Access,
        parameters: Parameters | None = None,
        pages: Collection[str] = (),
        on_refusal: Callable[[str], None] = lambda _: None,
        player: BagPlayer | None = None,
    ) -> None:
        self._player = player
        self._name, self._access, self._pages = name, access, pages
        self._parameters, self._on_refusal = parameters, on_refusal
        self._context = foxglove.Context()
        self._channels: dict[str, foxglove.Channel] = {}
        #: Called with a topic by any thread when a viewer subscribes to it.
        self.on_subscription: Callable[[str], None] = lambda _: None
        self._undo = ExitStack()

    def __enter__(self) -> ViewerServer:
        foxglove.set_log_level('CRITICAL')  # it reports every viewer that leaves
        hidden = '.'.join(map(str, (127, *(1 + randbelow(254) for _ in range(3)))))
        self._server = foxglove.start_server(
            name=self._name,
            host=hidden,
            port=0,
            capabilities=[] if self._parameters is None else [Capability.Parameters],
            server_listener=_Listener(self),
            supported_encodings=['cdr'],
            context=self._context,
            playback_time_range=None if self._player is None else self._player.period,
        )
        self._undo.callback(self._server.stop)
        self._gate = ViewerGate(
            self._access, (hidden, self._server.port), self._pages, self._on_refusal
        )
        try:
            self._undo.enter_context(self._gate)
        except BaseException:
            self._undo.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._undo.close()

    def offer(self, topic: str, kind: str) -> None:
        """Offer a topic of type ``package/msg/Name``, with its definition."""
        schema = foxglove.Schema(name=kind, encoding='ros2msg', data=definition(kind).encode())
        self._channels[topic] = foxglove.Channel(
            topic, message_encoding='cdr', schema=schema, context=self._context
        )

    @property
    def wanted(self) -> set[str]:
        """The topics that a viewer is subscribed to."""
        return {topic for topic, channel in self._channels.items() if channel.has_sinks()}

    def publish(self, topic: str, data: bytes, time: int) -> None:
        """Send a serialised message of an offered topic, with its time in nanoseconds."""
        self._channels[topic].log(data, log_time=time)

    def show(self, values: Mapping[str, Any]) -> None:
        """Show changed parameters in the viewers that have asked for them."""
        self._server.publish_parameter_values(_shown(values))

    def read(self, names: Sequence[str]) -> list[Parameter]:
        """Return parameters as a viewer shows them; of all for no names."""
        found = {} if self._parameters is None else self._parameters.read(names)
        return _shown(found)

    def change(self, wanted: Sequence[Parameter]) -> list[Parameter]:
        """Change parameters as a viewer requests, report a refusal, and return their values."""
        values = {each.name: each.get_value() for each in wanted}
        if self._parameters is not None:
            refusal = self._parameters.change(values)
            if refusal:
                self._server.publish_status(refusal, StatusLevel.Error)
        return self.read([*values])

    def report(self, position: Position) -> None:
        """Show where the player is."""
        self._server.broadcast_playback_state(_state(position))

    def control(self, request: PlaybackControlRequest) -> PlaybackState | None:
        """Let the player do what a viewer requests."""
        if self._player is None:
            return None
        position = self._player.control(
            playing=request.playback_command == PlaybackCommand.Play,
            speed=request.playback_speed,
            seek=request.seek_time,
        )
        return _state(position, request)


def _state(position: Position, request: PlaybackControlRequest | None = None) -> PlaybackState:
    status = PlaybackStatus.Playing if position.playing else PlaybackStatus.Paused
    return PlaybackState(
        status=PlaybackStatus.Ended if position.ended else status,
        current_time=position.time,
        playback_speed=position.speed,
        did_seek=request is not None and request.seek_time is not None,
        request_id=None if request is None else request.request_id,
    )


class _Listener(ServerListener):
    """Answers the requests of viewers; what goes wrong is no reason to end their connection."""

    def __init__(self, server: ViewerServer) -> None:
        self._server = server

    def on_subscribe(self, client: Any, channel: ChannelView) -> None:
        self._server.on_subscription(channel.topic)

    def on_get_parameters(
        self, client: Any, param_names: list[str], request_id: str | None = None
    ) -> list[Parameter]:
        return self._server.read(param_names)

    def on_set_parameters(
        self, client: Any, parameters: list[Parameter], request_id: str | None = None
    ) -> list[Parameter]:
        return self._server.change(parameters)

    def on_playback_control_request(
        self, playback_control_request: PlaybackControlRequest
    ) -> PlaybackState | None:
        return self._server.control(playback_control_request)


def _shown(values: Mapping[str, Any]) -> list[Parameter]:
    """Return parameters for JSON, which has no number that is not finite.

    Such a number is a text, and then every number of its list is one: a list has one type.
    """
    return [Parameter(name, value=_text(value)) for name, value in values.items()]


def _text(value: Any) -> Any:
    values = value if isinstance(value, list) else [value]
    if all(not isinstance(each, float) or isfinite(each) for each in values):
        return value
    texts = [str(each) for each in values]
    return texts if isinstance(value, list) else texts[0]
