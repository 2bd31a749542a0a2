# SPDX-License-Identifier: Apache-2.0
"""Make the pictures of docs/explanation/studies by the studies themselves.

python docs/make_study_pictures.py [NAME ...]
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from kalman_ros.harness import executables
from kalman_ros.programs.study import STUDIES

FOLDER = Path(__file__).parent / 'explanation' / 'studies'


def main(names: list[str]) -> None:
    """Run the studies, and keep the picture of each that passes."""
    for name in names or STUDIES:
        with tempfile.TemporaryDirectory() as folder:
            command = [str(executables.executable('study')), name, '--out', folder]
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode:
                sys.exit(f'make_study_pictures: {name}: {done.stdout[-2000:]}{done.stderr}')
            print(name, done.stdout.strip().splitlines()[-1], flush=True)
            shutil.copy(Path(folder, name, f'{name}.png'), FOLDER)


if __name__ == '__main__':
    main(sys.argv[1:])
