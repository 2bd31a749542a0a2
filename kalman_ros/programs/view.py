# SPDX-License-Identifier: Apache-2.0
"""Serve a loop or a recording to Foxglove, Lichtblick and PlotJuggler."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from kalman_ros import models
from kalman_ros.harness import NodeError
from kalman_ros.programs.common_arguments import add_parameters
from kalman_ros.programs.common_server import add_server
from kalman_ros.programs.refusal import refuse

#: The default port, which viewers suggest.
_PORT = 8765


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog='view',
        description='Start the nodes of a scenario in real time, and serve their topics and '
        'parameters to Foxglove, Lichtblick or PlotJuggler; or serve a recording, or the nodes '
        'that run in a ROS domain. Until Ctrl-C.',
        epilog='The server is only for this machine, unless --listen says otherwise: then '
        'everybody with the token can change the loop, and nothing is encrypted.',
    )
    parser.add_argument(
        'source', nargs='?', default=models.DEFAULT, metavar='SCENARIO | BAG',
        help='a name in config/, a parameter file, or a recording (default: %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--domain', type=int, metavar='N',
        help='start nothing, and serve this ROS domain; SCENARIO is for --layout and --rviz',
    )  # fmt: skip
    parser.add_argument(
        '--layout', type=Path, metavar='FILE', help='write a layout for the viewer into this file'
    )
    parser.add_argument(
        '--rviz', type=Path, metavar='FILE', help='write a configuration of RViz into this file'
    )
    parser.add_argument(
        '--params-file', default=models.DEFAULT, metavar='FILE',
        help='of a BAG: the scenario for --layout and --rviz',
    )  # fmt: skip
    add_server(parser, _PORT, 'server', 'viewer')
    parser.add_argument(
        '--page', action='append', default=[], metavar='ORIGIN',
        help='admit a viewer in a browser from here, such as http://localhost:8080; may be '
        'repeated',
    )  # fmt: skip
    parser.add_argument('--seed', type=int, default=0, metavar='N', help='of all noise')
    add_parameters(parser, 'a parameter for every node, as with --ros-args')
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> None:
    """Serve until a signal."""
    options = arguments(argv)
    try:
        from kalman_ros.programs.viewing import Viewing
    except ModuleNotFoundError as error:
        if error.name != 'foxglove':
            raise
        refuse('view', RuntimeError('it needs foxglove-sdk 0.30: pip install foxglove-sdk'))
    try:
        Viewing(options).run()
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except (ValueError, NodeError, RuntimeError, OSError) as error:
        refuse('view', error)
