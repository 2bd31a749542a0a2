# SPDX-License-Identifier: Apache-2.0
"""A page on this machine that shows the running loop and changes it."""

from __future__ import annotations

import argparse
import os
import webbrowser
from collections.abc import Sequence

from kalman_ros.harness import NodeError
from kalman_ros.live.board import Board
from kalman_ros.live.live_loop import LiveLoop
from kalman_ros.programs.common_arguments import add_parameters, add_scenario
from kalman_ros.programs.common_server import access, add_server
from kalman_ros.programs.refusal import refuse
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import overrides

#: The default port.
_PORT = 8642
#: Environment variables, one of which is set where a browser can open a window.
_DISPLAYS = ('DISPLAY', 'WAYLAND_DISPLAY')


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        prog='live',
        description='Start the nodes of a scenario in real time, and a page that shows them and '
        'changes their parameters. Ctrl-C ends both.',
        epilog='The page is only for this machine, unless --listen says otherwise: then '
        'everybody with the token can change the loop, and nothing is encrypted.',
    )
    add_scenario(parser)
    add_server(parser, _PORT, 'page', 'browser')
    parser.add_argument('--no-browser', action='store_true', help='only print the address')
    parser.add_argument('--seed', type=int, default=0, metavar='N', help='of all noise')
    add_parameters(parser, 'a parameter for every node, as with --ros-args')
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> None:
    """Run the nodes and the page until a signal."""
    options = arguments(argv)
    try:
        from kalman_ros.live.web_server import WebServer
    except ModuleNotFoundError:
        refuse('live', RuntimeError('it needs websockets 13 or newer: pip install websockets'))
    board = Board()
    try:
        rules = access(options)
        file = shipped.file(options.scenario)
        loop = LiveLoop(file, overrides(options.parameters), options.seed, board)
        with WebServer(board, loop.command, rules):
            print(f'{file.stem}: {rules.url}  (Ctrl-C ends)', flush=True)
            # without a display, it would start a browser in this terminal
            if not options.no_browser and any(map(os.environ.get, _DISPLAYS)):
                webbrowser.open(rules.url)
            loop.run()
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except (ValueError, NodeError, RuntimeError, OSError) as error:
        refuse('live', error)
