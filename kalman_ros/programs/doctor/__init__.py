# SPDX-License-Identifier: Apache-2.0
"""The program `doctor`: faults of a recording and of its parameters, with their proof."""

import os
import sys

# on matrices of this size the threads of BLAS mostly wait for each other, at full load; numpy
# reads this when it is loaded, so that it has effect in the program alone
if 'numpy' not in sys.modules:
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
