# SPDX-License-Identifier: Apache-2.0
"""Make the pictures of docs/reference/scenarios by the demo of each scenario, and docs/states.png.

python docs/make_scenario_pictures.py [NAME ...]
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from kalman_ros import models
from kalman_ros.harness import executables
from kalman_ros.scenario import shipped

DOCS = Path(__file__).parent
FOLDER = DOCS / 'reference' / 'scenarios'
#: Scenarios with an animation beside their picture.
MOVING = ('bearing_tracker', 'cart_pole')
#: Colours of the picture in README.
COLOURS = 64


def main(names: list[str]) -> None:
    """Run the demos with seed 0, and keep their pictures."""
    for name in names or shipped.names():
        with tempfile.TemporaryDirectory() as folder:
            moving = ['--animate'] if name in MOVING else []
            command = [str(executables.executable('demo')), name, '--out', folder, *moving]
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode:
                sys.exit(f'make_scenario_pictures: {name}: {done.stdout[-2000:]}{done.stderr}')
            print(name, done.stdout.strip().splitlines()[-1], flush=True)
            shutil.copy(Path(folder, 'overview.png'), FOLDER / f'{name}.png')
            if moving:
                shutil.copy(Path(folder, 'animation.gif'), FOLDER / f'{name}.gif')
            if name == models.DEFAULT:
                with Image.open(Path(folder, 'states.png')) as image:
                    image.convert('RGB').quantize(COLOURS).save(DOCS / 'states.png', optimize=True)


if __name__ == '__main__':
    main(sys.argv[1:])
