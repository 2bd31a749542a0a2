# SPDX-License-Identifier: Apache-2.0
"""A datum that outlasts the estimator, in a file that is a ROS parameter file, too."""

from __future__ import annotations

import os
from pathlib import Path
from tempfile import mkstemp

from kalman_ros.core.geodesy import Place, place
from kalman_ros.scenario.parameter_files import from_file

_TEXT = """\
# The datum that the first fix has set; without this file the next first fix sets another.
/**:
  ros__parameters:
    datum: [{:.9f}, {:.9f}, {:.4f}]
"""


def read_datum(file: str) -> Place | None:
    """Return the datum in a file; None if there is no file yet.

    Raises
    ------
    ValueError
        If the file cannot be read or contains something else.
    """
    path = Path(file)
    if path.exists() and not path.is_file():  # a pipe would be waited for
        raise ValueError(f"datum_file: '{file}': expected a file, not a directory or a pipe")
    try:
        values = from_file(path)
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ValueError(f"datum_file: '{file}': {reason}") from None
    datum = values.get('datum')
    if not isinstance(datum, list) or not all(type(item) in (int, float) for item in datum):
        raise ValueError(f"datum_file: '{file}': expected a datum, got {datum!r}")
    try:
        return place('datum', datum)
    except ValueError as error:
        raise ValueError(f"datum_file: '{file}': {error}") from None


def write_datum(file: str, datum: Place) -> None:
    """Write a datum into a file, which is complete or absent at every instant.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    path = Path(file)
    # a new file, since a name that can be guessed may be a link of somebody else's
    descriptor, new = mkstemp(prefix=f'{path.name}.', dir=path.parent)
    try:
        with open(descriptor, 'w') as text:
            text.write(_TEXT.format(*datum))
        os.replace(new, path)
    except OSError:
        os.unlink(new)
        raise
