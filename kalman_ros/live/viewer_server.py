# SPDX-License-Identifier: Apache-2.0
"""Server of topics and parameters for Foxglove, Lichtblick and PlotJuggler."""

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
    """Access to parameters for a viewer; the values are those of ROS parameters."""

    def read(self, names: Sequence[str]) -> Mapping[str, Any]:
        """Return the values of parameters that exist, or of all parameters for no names."""
        ...

    def change(self, values: Mapping[str, Any]) -> str:
        """Change parameters; return the reason of a refusal, or ''."""
        ...


class ViewerServer:
    """A server of topics and parameters for viewers, in separate threads; a context manager.

    The server of foxglove-sdk admits every client that can reach it. Therefore it listens on a
    random address of the loopback network and a random port, which are known only to a
    `ViewerGate` that admits viewers.

    Parameters
    ----------
    name
        Name that the viewer shows.
    access, pages, on_refusal
        As for `ViewerGate`.
    parameters
        Parameters that viewers read and change, called from any thread; None for no parameters.
    player
        Player of a recording that viewers control.
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
        #: Receives a topic, in any thread, when a viewer subscribes to it.
        self.on_subscription: Callable[[str], None] = lambda _: None
        self._exit_stack = ExitStack()

    def __enter__(self) -> ViewerServer:
        foxglove.set_log_level('CRITICAL')  # lower levels report every viewer that disconnects
        host = '.'.join(map(str, (127, *(1 + randbelow(254) for _ in range(3)))))
        self._server = foxglove.start_server(
            name=self._name,
            host=host,
            port=0,
            capabilities=[] if self._parameters is None else [Capability.Parameters],
            server_listener=_Listener(self),
            supported_encodings=['cdr'],
            context=self._context,
            playback_time_range=None if self._player is None else self._player.period,
        )
        self._exit_stack.callback(self._server.stop)
        self._gate = ViewerGate(
            self._access, (host, self._server.port), self._pages, self._on_refusal
        )
        try:
            self._exit_stack.enter_context(self._gate)
        except BaseException:
            self._exit_stack.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._exit_stack.close()

    def offer(self, topic: str, kind: str) -> None:
        """Offer a topic of type ``package/msg/Name``, with the definition of the type."""
        schema = foxglove.Schema(name=kind, encoding='ros2msg', data=definition(kind).encode())
        self._channels[topic] = foxglove.Channel(
            topic, message_encoding='cdr', schema=schema, context=self._context
        )

    @property
    def wanted(self) -> set[str]:
        """Topics to which a viewer is subscribed."""
        return {topic for topic, channel in self._channels.items() if channel.has_sinks()}

    def publish(self, topic: str, data: bytes, time: int) -> None:
        """Send a serialised message of an offered topic, with its time in nanoseconds."""
        self._channels[topic].log(data, log_time=time)

    def show(self, values: Mapping[str, Any]) -> None:
        """Show changed parameters in the viewers that have requested them."""
        self._server.publish_parameter_values(_to_viewer(values))

    def read(self, names: Sequence[str]) -> list[Parameter]:
        """Return parameters as a viewer shows them, or all parameters for no names."""
        values = {} if self._parameters is None else self._parameters.read(names)
        return _to_viewer(values)

    def change(self, parameters: Sequence[Parameter]) -> list[Parameter]:
        """Change parameters as a viewer requests, report a refusal, and return the values."""
        values = {parameter.name: parameter.get_value() for parameter in parameters}
        if self._parameters is not None:
            refusal = self._parameters.change(values)
            if refusal:
                self._server.publish_status(refusal, StatusLevel.Error)
        return self.read([*values])

    def report(self, position: Position) -> None:
        """Show the position of the player."""
        self._server.broadcast_playback_state(_state(position))

    def control(self, request: PlaybackControlRequest) -> PlaybackState | None:
        """Pass the request of a viewer to the player; return the new state."""
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
    """A listener that answers the requests of viewers; errors do not end their connection."""

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


def _to_viewer(values: Mapping[str, Any]) -> list[Parameter]:
    """Return parameters for JSON, which has only finite numbers.

    A number that is not finite becomes a text, and so do all numbers of its list, since a list has
    one type.
    """
    return [Parameter(name, value=_json_value(value)) for name, value in values.items()]


def _json_value(value: Any) -> Any:
    values = value if isinstance(value, list) else [value]
    if all(not isinstance(number, float) or isfinite(number) for number in values):
        return value
    texts = [str(number) for number in values]
    return texts if isinstance(value, list) else texts[0]
