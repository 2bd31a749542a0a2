# SPDX-License-Identifier: Apache-2.0
"""The entry point of every executable: installs signal handlers before slow imports.

By default SIGINT prints a traceback of the module being imported. Until the program takes over
there is nothing to clean up, so the process just ends.
"""

from __future__ import annotations

# First of all, and not `signal`, which takes a millisecond to load: from here on, Ctrl-C prints no
# traceback of an import
import _signal as signal  # type: ignore[import-not-found]

if signal.getsignal(signal.SIGINT) == signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)

import errno
import os
import resource
import sys
import warnings
from functools import partial
from importlib import import_module
from pathlib import Path

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable

_PACKAGE = Path(__file__).parent
#: The disk is full or read-only: not an error of the program.
_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES)
#: Bytes of address space that a node takes: 1.1e9, most of it reserved for threads and not used.
_ADDRESS_SPACE = 1 << 30
#: Ctrl-C, a launcher's request, a closed terminal (unless ``nohup`` has it ignored), Ctrl-\\.
_SIGNALS = tuple(
    number
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
    if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN
)

# on matrices of this size the threads of BLAS mostly wait for each other, at full load and, in a
# node, at its real-time priority; numpy reads this when it is loaded
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

# what is not finite is refused, counted and named; numpy's lines about how it came are no help
if not sys.warnoptions:
    warnings.simplefilter('ignore', RuntimeWarning)


def _node(name: str) -> None:
    """Run a node, which handles signals itself; exit 0 if one arrives before."""
    for number in _SIGNALS:
        signal.signal(number, lambda *_: os._exit(0))
    _require_address_space(name)
    import_module(f'kalman_ros.nodes.{name}.node').main()


def _require_address_space(name: str) -> None:
    """Exit if too little is allowed: the libraries would fail in many ways, or not end at all."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < _ADDRESS_SPACE:
        needs = f'{_ADDRESS_SPACE >> 20} MiB of address space or more, got {limit >> 20}'
        sys.exit(f'{name}: expected {needs}: raise the limit (ulimit -v)')


def run(name: str, module: str) -> None:
    """Run a program by its module's ``main``; exit 128 + N if a signal N interrupts it."""
    for number in _SIGNALS:
        signal.signal(number, lambda number, _: os._exit(128 + number))
    _require_address_space(name)
    main = import_module(module).main
    try:
        for number in _SIGNALS:
            signal.signal(number, lambda number, _: sys.exit(128 + number))
        signal.signal(signal.SIGINT, signal.default_int_handler)
        main()
    except OSError as error:
        if error.errno not in _DISK:
            raise
        where = f": '{error.filename}'" if error.filename else ''
        sys.exit(f'{name}: cannot write: {error.strerror}{where}')
    except KeyboardInterrupt:
        print(f'{name}: interrupted; nothing is left running', file=sys.stderr)
        sys.exit(128 + signal.SIGINT)
    finally:
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_IGN)


def __getattr__(name: str) -> Callable[[], None]:
    """Return what runs a node, a folder of `nodes`, or a program, of `programs`, by its name."""
    if not name.startswith('_'):
        if (_PACKAGE / 'nodes' / name / 'node.py').is_file():
            return partial(_node, name)
        if (_PACKAGE / 'programs' / name / 'program.py').is_file():
            return partial(run, name, f'kalman_ros.programs.{name}.program')
        if (_PACKAGE / 'programs' / f'{name}.py').is_file():
            return partial(run, name, f'kalman_ros.programs.{name}')
    raise AttributeError(name)


def names() -> list[str]:
    """Return the names of all nodes and programs."""
    files = _PACKAGE.glob('programs/*.py')
    return sorted(
        [path.parent.name for path in _PACKAGE.glob('nodes/*/node.py')]
        + [path.parent.name for path in _PACKAGE.glob('programs/*/program.py')]
        + [path.stem for path in files if '\ndef main(' in path.read_text('utf-8')]
    )


#: Modules of ROS 2, which pip does not install.
_ROS = (
    'rclpy', 'ament_index_python', 'rcl_interfaces', 'rosidl_generator_py', 'rosidl_parser',
    'rpyutils', 'std_srvs',
)  # fmt: skip


def main() -> None:
    """Run ``kalman_ros COMMAND ...``: what pip installs in place of an executable for each."""
    name = sys.argv[1] if len(sys.argv) > 1 else ''
    if name not in names():
        asked = name in ('', '-h', '--help')
        lines = f'usage: kalman_ros COMMAND ...\n\ncommands: {", ".join(names())}'
        sys.exit(print(lines) if asked else f"kalman_ros: unknown command '{name}'\n{lines}")
    sys.argv[:2] = [name]
    try:
        getattr(sys.modules[__name__], name)()
    except ModuleNotFoundError as error:
        if (error.name or '').partition('.')[0] not in _ROS and 'msgs' not in (error.name or ''):
            raise
        sys.exit(f"{name}: it needs ROS 2 (no module '{error.name}'): source its setup.bash first")
