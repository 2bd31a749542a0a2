# SPDX-License-Identifier: Apache-2.0
"""Routines of BLAS and LAPACK, without the rest of ``scipy.linalg``.

For matrices of a few rows a Cholesky factor takes a fifth of the time of numpy's, and a product
with a sum two thirds. The package around them takes a third of a second to import and
nodes do not use it; so scipy's extension modules are loaded directly where they are found,
and through their package elsewhere.

Arguments are positional; keywords take twice the time:

========================================================  ========================================
``dgemm(alpha, A, B, beta, C, trans_a, trans_b, over)``   alpha A B + beta C, A or B transposed
``dgemv(alpha, A, x, beta, y, 0, 1, 0, 1, trans, over)``  alpha A x + beta y, A transposed
``dger(alpha, x, y, 1, 1, A, 1, 1, over)``                A + alpha x y'
``dsymm(alpha, A, B)``                                    alpha A B; of A the upper triangle
``dposv(A, B)``                                           a factor, A^-1 B, and 0 if A is definite
``dpotrf(A, lower, clean)``                               a factor, and 0 if A is definite
``dpotrs(L, B)``                                          A^-1 B by a factor, and 0
``dtrtri(L, lower)``                                      L^-1 of a triangle, and 0 if it exists
========================================================  ========================================

C, y or A is overwritten if ``over`` is 1, else copied. Fortran matrices are column-major:
arrays in that order are not copied; every other order is accepted.
"""

from __future__ import annotations

from importlib import import_module
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any


def _load(name: str) -> Any:
    """Return the extension module of ``scipy.linalg`` for ``'lapack'`` or ``'blas'``."""
    scipy = find_spec('scipy')
    for folder in (scipy and scipy.submodule_search_locations) or ():
        for suffix in EXTENSION_SUFFIXES:
            spec = spec_from_file_location(
                f'_f{name}', Path(folder) / 'linalg' / f'_f{name}{suffix}'
            )
            try:
                module = module_from_spec(spec)  # type: ignore[arg-type]
                spec.loader.exec_module(module)  # type: ignore[union-attr]
            except ImportError:
                continue
            return module
    return import_module(f'scipy.linalg.{name}')


_blas, _lapack = _load('blas'), _load('lapack')
dgemm = _blas.dgemm
dgemv = _blas.dgemv
dger = _blas.dger
dsymm = _blas.dsymm
dposv = _lapack.dposv
dpotrf = _lapack.dpotrf
dpotrs = _lapack.dpotrs
dtrtri = _lapack.dtrtri
