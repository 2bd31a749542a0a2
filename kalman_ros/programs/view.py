# SPDX-License-Identifier: Apache-2.0
"""Serves a running loop to Foxglove, Lichtblick and PlotJuggler."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import yaml

from kalman_ros.harness import NodeError
from kalman_ros.harness.graph_topics import GraphTopics
from kalman_ros.live.adjustments import Adjustments
from kalman_ros.live.graph_parameters import GraphParameters
from kalman_ros.live.map_extent import is_drawn
from kalman_ros.live.rviz_file import rviz_file
from kalman_ros.live.viewed_nodes import ViewedNodes
from kalman_ros.live.viewer_layout import layout
from kalman_ros.programs.common_arguments import add_parameters, add_scenario
from kalman_ros.programs.common_server import access, add_server
from kalman_ros.programs.refusal import refuse
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import overrides

#: The default port, which viewers suggest.
_PORT = 8765


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog='view',
        description='Start the nodes of a scenario in real time, and serve their topics and '
        'parameters to Foxglove, Lichtblick or PlotJuggler. Ctrl-C ends both.',
        epilog='The server is only for this machine, unless --listen says otherwise: then '
        'everybody with the token can change the loop, and nothing is encrypted.',
    )
    add_scenario(parser)
    parser.add_argument(
        '--layout', type=Path, metavar='FILE', help='write a layout for the viewer into this file'
    )
    parser.add_argument(
        '--rviz', type=Path, metavar='FILE', help='write a configuration of RViz into this file'
    )
    add_server(parser, _PORT, 'server', 'viewer')
    parser.add_argument(
        '--page', action='append', default=[], metavar='ORIGIN',
        help='admit a viewer in a browser from here, such as http://localhost:8080; may be '
        'repeated',
    )  # fmt: skip
    parser.add_argument('--seed', type=int, default=0, metavar='N', help='of all noise')
    add_parameters(parser, 'a parameter for every node, as with --ros-args')
    return parser.parse_args(argv)


def write_files(options: argparse.Namespace, found: Adjustments) -> None:
    """Write the layout and the configuration of RViz that were asked for.

    Raises
    ------
    ValueError
        If RViz cannot show the scenario.
    """
    scenario, frame = found.scenario('estimator'), str(found.value('estimator', 'frame'))
    if options.layout:
        _write(options.layout, json.dumps(layout(scenario, frame), indent=2) + '\n')
    if options.rviz:
        if not is_drawn(scenario):
            names = ', '.join(scenario.model.state.names)
            raise ValueError(
                f'--rviz: expected a state with x and y, and visualization_msgs, got ({names})'
            )
        _write(options.rviz, yaml.safe_dump(rviz_file(scenario, frame), sort_keys=False))


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    print(f'wrote {path}')


@contextmanager
def _graph(domain: int) -> Iterator[tuple[GraphTopics, GraphParameters]]:
    graph = GraphTopics('viewer', domain=domain, every=True)
    parameters = GraphParameters(graph)
    try:
        yield graph, parameters
    finally:
        parameters.close()
        graph.close()


def main(argv: Sequence[str] | None = None) -> None:
    """Run the nodes and the server until a signal."""
    options = arguments(argv)
    try:
        from kalman_ros.live.viewer_loop import ViewerLoop
        from kalman_ros.live.viewer_server import ViewerServer
    except ModuleNotFoundError:
        refuse('view', RuntimeError('it needs foxglove-sdk 0.30: pip install foxglove-sdk'))
    try:
        rules = access(options)
        file = shipped.file(options.scenario)
        found = Adjustments(file, overrides(options.parameters))
        write_files(options, found)
        nodes = ViewedNodes(found, options.seed)
        print(f'{file.stem}: starting the nodes', flush=True)
        with (
            nodes,
            _graph(nodes.domain) as (graph, parameters),
            ViewerServer(file.stem, rules, parameters, options.page, _report) as server,
        ):
            address = rules.url.replace('http', 'ws', 1)
            print(f'{file.stem}: {address} and ROS domain {nodes.domain}  (Ctrl-C ends)')
            sys.stdout.flush()
            ViewerLoop(graph, server).run(lambda: nodes.spin(0.0))
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except (ValueError, NodeError, RuntimeError, OSError) as error:
        refuse('view', error)


def _report(why: str) -> None:
    print(f'refused {why}', file=sys.stderr, flush=True)
