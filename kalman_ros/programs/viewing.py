# SPDX-License-Identifier: Apache-2.0
"""The server of `view`: the nodes of a scenario, another ROS domain, or a recording."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from re import fullmatch

import yaml

from kalman_ros.bags.reading import Bag
from kalman_ros.harness.graph_topics import GraphTopics
from kalman_ros.live.adjustments import Adjustments
from kalman_ros.live.bag_player import BagPlayer
from kalman_ros.live.graph_parameters import GraphParameters
from kalman_ros.live.map_extent import is_drawn
from kalman_ros.live.rviz_file import rviz_file
from kalman_ros.live.viewed_nodes import ViewedNodes
from kalman_ros.live.viewer_layout import layout
from kalman_ros.live.viewer_loop import ViewerLoop
from kalman_ros.live.viewer_server import ViewerServer
from kalman_ros.programs.common_server import access
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import overrides

#: The last domain of ROS, and the suffixes of recordings.
_LAST_DOMAIN = 232
_RECORDINGS = ('.mcap', '.db3', '.bag')


class Viewing:
    """Server of the source that the command line names.

    Parameters
    ----------
    options
        The parsed command line.

    Raises
    ------
    ValueError
        If an option is wrong.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._options, self._rules = options, access(options)
        if options.domain is not None and not 0 <= options.domain <= _LAST_DOMAIN:
            raise ValueError(f'--domain: expected 0 to {_LAST_DOMAIN}, got {options.domain}')
        for page in options.page:
            if not fullmatch(r'[a-z][a-z0-9+.-]*://[^/\s,]*', page):
                expected = 'expected an origin, such as http://localhost:8080'
                raise ValueError(f"--page: {expected}, got '{page}'")

    def run(self) -> None:
        """Serve until a signal."""
        options = self._options
        source = Path(options.source)
        named = options.source in shipped.names()
        if options.domain is not None:
            self._write_files(options.source)
            self._serve_domain(options.domain)
        elif not named and (source.is_dir() or source.suffix in _RECORDINGS):
            self._write_files(options.params_file)
            self._serve_recording(Bag(source))
        else:
            self._serve_nodes(self._write_files(options.source, ordered=True))

    def _write_files(self, name: str, *, ordered: bool = False) -> Adjustments:
        """Write the requested files, and return the parameters of a scenario."""
        adjustments = Adjustments(shipped.file(name), overrides(self._options.parameters))
        _write_files(self._options, adjustments, ordered=ordered)
        return adjustments

    def _serve_nodes(self, adjustments: Adjustments) -> None:
        if adjustments.shared.get('lockstep'):
            print('in real time, without lockstep: viewers follow the clock', file=sys.stderr)
        self._rules.check_port()
        nodes, name = ViewedNodes(adjustments, self._options.seed), adjustments.file.stem
        print(f'{name}: starting the nodes', flush=True)
        with (
            nodes,
            _graph(nodes.domain) as (graph, parameters),
            self._server(name, parameters) as server,
        ):
            self._say(f'{name} (ROS domain {nodes.domain})')
            ViewerLoop(graph, server).run(lambda: nodes.spin(0.0))

    def _serve_domain(self, domain: int) -> None:
        name = f'ROS domain {domain}'
        with _graph(domain) as (graph, parameters), self._server(name, parameters) as server:
            self._say(name)
            ViewerLoop(graph, server).run()

    def _serve_recording(self, bag: Bag) -> None:
        player = BagPlayer(bag)
        for line in (*bag.damage, *(f'{topic}: {why}' for topic, why in player.refused.items())):
            print(f'not served: {line}', file=sys.stderr)
        with self._server(bag.path.name, None, player) as server:
            for topic, kind in player.topics.items():
                server.offer(topic, kind)
            self._say(str(bag.path))
            player.run(server)

    def _server(
        self, name: str, parameters: GraphParameters | None, player: BagPlayer | None = None
    ) -> ViewerServer:
        return ViewerServer(
            name, self._rules, parameters, self._options.page, _report_refusal, player
        )

    def _say(self, name: str) -> None:
        print(f'{name}: {self._rules.url.replace("http", "ws", 1)}  (Ctrl-C ends)', flush=True)


@contextmanager
def _graph(domain: int) -> Iterator[tuple[GraphTopics, GraphParameters]]:
    graph = GraphTopics('viewer', domain=domain, every=True)
    parameters = GraphParameters(graph)
    try:
        yield graph, parameters
    finally:
        parameters.close()
        graph.close()


@lru_cache(maxsize=100)  # each reason once: a page tries again and again
def _report_refusal(why: str) -> None:
    print(f'refused {why}', file=sys.stderr, flush=True)


def _write_files(options: argparse.Namespace, adjustments: Adjustments, *, ordered: bool) -> None:
    """Write the layout and the configuration of RViz, as requested.

    ``ordered`` is as for `layout`.

    Raises
    ------
    ValueError
        If RViz cannot show the scenario.
    """
    scenario, frame = (
        adjustments.scenario('estimator'),
        str(adjustments.value('estimator', 'frame')),
    )
    if options.layout:
        content = layout(scenario, frame, ordered=ordered)
        _write('--layout', options.layout, json.dumps(content, indent=2) + '\n')
    if options.rviz:
        if not is_drawn(scenario):
            names = ', '.join(scenario.model.state.names)
            raise ValueError(
                f'--rviz: expected a state with x and y, and visualization_msgs, got ({names})'
            )
        _write('--rviz', options.rviz, yaml.safe_dump(rviz_file(scenario, frame), sort_keys=False))


def _write(option: str, path: Path, text: str) -> None:
    """Write a file; ValueError if it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    except OSError as error:
        raise ValueError(f'{option}: cannot write {path}: {error.strerror}') from None
    print(f'wrote {path}')
