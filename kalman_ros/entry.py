# SPDX-License-Identifier: Apache-2.0
"""Where every executable starts: signals are answered before anything slow is loaded.

Python's own answer to SIGINT is a traceback of whatever was being imported. Until the program
takes over there is nothing to clean up, so it just ends.
"""

from __future__ import annotations

# `signal` itself builds enumerations while it is loaded, for a millisecond in which Ctrl-C would
# be a traceback
import _signal as signal  # type: ignore[import-not-found]
import errno
import os
import sys
from functools import partial
from importlib import import_module

#: The disk is full, or not to be written to: no mistake of the program.
_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES)
#: Ctrl-C, a launcher's request, a closed terminal (unless ``nohup`` has it ignored), Ctrl-\\.
_SIGNALS = tuple(
    number
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
    if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN
)


def _node(name: str) -> None:
    """Run a node, which says by itself how it answers signals; exit 0 if one comes before."""
    for number in _SIGNALS:
        signal.signal(number, lambda *_: os._exit(0))
    import_module(f'kalman_ros.nodes.{name}').main()


def _program(name: str, module: str = '') -> None:
    """Run a program of `kalman_ros.programs`; exit 128 + N if a signal N interrupts it."""
    for number in _SIGNALS:
        signal.signal(number, lambda number, _: os._exit(128 + number))
    main = import_module(f'kalman_ros.programs.{module or name}').main
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


plant = partial(_node, 'plant')
estimator = partial(_node, 'estimator')
controller = partial(_node, 'controller')
monitor = partial(_node, 'monitor')
microphone_array = partial(_node, 'microphone_array')

bench = partial(_program, 'bench', 'bench.program')
compare = partial(_program, 'compare', 'compare.program')
demo = partial(_program, 'demo')
design = partial(_program, 'design')
faults = partial(_program, 'faults', 'faults.program')
fuzz = partial(_program, 'fuzz', 'fuzz.program')
soak = partial(_program, 'soak', 'soak.program')
study = partial(_program, 'study')
