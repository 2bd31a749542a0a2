# SPDX-License-Identifier: Apache-2.0
"""The entry of all executables: what it sets before numpy is loaded."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow


@pytest.mark.parametrize('given', ['', '3'])
def test_matrices_have_one_thread_unless_the_user_wants_more(given):
    environment = {k: v for k, v in os.environ.items() if k != 'OPENBLAS_NUM_THREADS'}
    if given:
        environment['OPENBLAS_NUM_THREADS'] = given
    code = 'import kalman_ros.entry, os, sys; print(os.environ["OPENBLAS_NUM_THREADS"])'
    code += '; assert "numpy" not in sys.modules'
    found = subprocess.run(
        [sys.executable, '-c', code], env=environment, capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == (given or '1')
