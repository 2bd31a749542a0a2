# SPDX-License-Identifier: Apache-2.0
"""The example of the page on boards runs in an emulator, where there are one and a compiler."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from kalman_ros.programs import export

pytest.importorskip('casadi')
EXAMPLES = Path(__file__).parents[2] / 'docs' / 'examples'
PAGE = EXAMPLES.parent / 'how_to' / 'embedded.md'
TOOLS = 'make', 'arm-none-eabi-gcc', 'qemu-system-arm'


@pytest.mark.slow
@pytest.mark.skipif(
    not all(map(shutil.which, TOOLS)), reason=f'it takes {", ".join(TOOLS)} on the path'
)
def test_the_cart_pole_stands_on_an_emulated_board(tmp_path):
    folder = tmp_path / 'cart_c'
    arguments = ['cart_pole', '--precision', 'float32', '--out', str(folder), '--no-build']
    export.main([*arguments, '--steps', '5'])
    done = subprocess.run(
        ['make', '-C', EXAMPLES / 'board', f'LOOP={folder}', 'run'],
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    poles = [float(each) for each in re.findall(r'pole +(\S+) rad', done.stdout)]
    assert poles[0] == 0.05
    assert len(poles) == 5
    assert abs(poles[-1]) < 1e-3
    shown = re.search(r'LOOP=\S+ run\n(.*?)\n```', PAGE.read_text(), re.S)[1].splitlines()
    lines = done.stdout.splitlines()
    assert [line for line in shown[:2] if line not in lines] == []
    # which compiler it was decides the number of instructions
    ticks = int(re.search(r'takes (\d+) ticks', done.stdout)[1])
    assert ticks == pytest.approx(int(re.search(r'takes (\d+) ticks', shown[-1])[1]), rel=0.2)


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which('g++'), reason='there is no C++ compiler')
def test_the_header_is_read_by_cpp(tmp_path):
    export.main(['cart_pole', '--out', str(tmp_path / 'c'), '--no-build', '--steps', '5'])
    (tmp_path / 'a.cpp').write_text(
        '#include "c/cart_pole.h"\nint main() { cart_pole_loop l; cart_pole_init(&l); '
        'return static_cast<int>(CART_POLE_STATES) - 4; }\n'
    )
    command = ['g++', '-std=c++17', '-Wall', '-Wextra', '-Werror', '-fsyntax-only', 'a.cpp']
    subprocess.run(command, cwd=tmp_path, check=True, timeout=60)
