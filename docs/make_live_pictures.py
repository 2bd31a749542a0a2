# SPDX-License-Identifier: Apache-2.0
"""Make docs/live.png and docs/live.gif of the live page, with a headless Chromium.

python docs/make_live_pictures.py
"""

from __future__ import annotations

import base64
import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from PIL import Image

from kalman_ros.harness import executables

sys.path.insert(0, str(Path(__file__).parent))

from chromium import Chromium, program

FOLDER = Path(__file__).parent
#: Of the picture; and of the animation, with its number of frames and seconds between them.
SIZE, SMALL, FRAMES, PERIOD = (1280, 800), (480, 412), 40, 0.1
#: A cart that starts beside the end of its track.
SCENARIO = 'examples/cart_on_a_track.yaml'


def main() -> None:
    """Run a scenario, take the pictures, and stop it."""
    if not program():
        sys.exit('make_live_pictures: it needs Chromium')
    port = '8643'
    command = [str(executables.executable('live')), str(FOLDER / SCENARIO)]
    command += ['--no-browser', '--port', port]
    loop = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)
    try:
        assert loop.stdout is not None
        print(loop.stdout.readline(), end='')
        with Chromium(*SIZE) as page:
            page.open(f'http://127.0.0.1:{port}/')
            page.until('Number.parseFloat(document.getElementById("clock")?.textContent) > 4', 120)
            page.click('[data-task=limits]')
            page.until('document.querySelectorAll("#effects canvas").length === 2', 120)
            time.sleep(2.0)
            (FOLDER / 'live.png').write_bytes(_small(page.picture(), SIZE, 64))
            _animate(page)
    finally:
        os.killpg(loop.pid, signal.SIGTERM)
        loop.wait(20)


def _animate(page: Chromium) -> None:
    """Start again, twice, and write what the system does."""
    frames = []
    for k in range(FRAMES):
        if k in (0, 20):
            page.run('reset.click()')
        picture = page.run('document.getElementById("system").toDataURL()').partition(',')[2]
        frames.append(_decoded(picture))
        time.sleep(PERIOD)
    first, *rest = frames
    first.save(
        FOLDER / 'live.gif', save_all=True, append_images=rest, loop=0, optimize=True,
        duration=round(1e3 * PERIOD),
    )  # fmt: skip


def _decoded(text: str) -> Image.Image:
    drawn = Image.open(io.BytesIO(base64.b64decode(text))).convert('RGBA')
    paper = Image.new('RGBA', drawn.size, '#f5f6f7')
    paper.alpha_composite(drawn)
    return paper.convert('RGB').resize(SMALL).quantize(48)


def _small(data: bytes, size: tuple[int, int], colours: int) -> bytes:
    """Return a PNG with few colours."""
    into = io.BytesIO()
    Image.open(io.BytesIO(data)).convert('RGB').resize(size).quantize(colours).save(
        into, 'png', optimize=True
    )
    return into.getvalue()


if __name__ == '__main__':
    main()
