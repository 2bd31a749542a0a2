# SPDX-License-Identifier: Apache-2.0
"""Runs a program in this process: what it prints and its exit code, without starting Python."""

import sys
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from tempfile import TemporaryFile

from kalman_ros import entry


def run_command(name, *arguments):
    """Return exit code, standard output and standard error of a program."""
    # as the executable does, but for the handlers of signals
    program = getattr(entry, name, None)
    module = program.args[-1] if program else f'tools.{name}.program'
    with (
        TemporaryFile('w+') as out,  # which has a descriptor, as the streams of a process have
        TemporaryFile('w+') as err,
        redirect_stdout(out),
        redirect_stderr(err),
    ):
        try:
            import_module(module).main([*map(str, arguments)])
            code = 0
        except SystemExit as ended:
            code = ended.code or 0
            if isinstance(code, str):
                print(code, file=sys.stderr)
                code = 1
        return code, *map(_text, (out, err))


def _text(file):
    file.seek(0)
    return file.read()
