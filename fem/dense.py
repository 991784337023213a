"""BLAS and LAPACK on parts of matrices in place, which scipy's array functions would copy first.

Matrices lie column by column; a part is the address of its first number and the distance between its
columns. The routines are those that scipy ships for compiled code (scipy.linalg.cython_blas and
cython_lapack). Who calls keeps the arrays alive, of float64, and the parts inside them.
"""

import ctypes
from functools import cache
from typing import Any

import scipy.linalg.cython_blas  # noqa: F401, loaded before solver.one_thread looks for libraries
from numba.extending import get_cython_function_address

LARGEST = 96  # beyond it OpenBLAS's dpotrf is slower than its halves
FEW = 2  # right-hand sides, one at a time faster than together


@cache
def _routine(module: str, name: str, arguments: int) -> Any:
    kind = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * arguments)
    return kind(get_cython_function_address(f"scipy.linalg.{module}", name))


@cache
def _integer(value: int) -> Any:
    """Return a constant that Fortran can take by reference."""
    return ctypes.byref(ctypes.c_int(value))


@cache
def _letter(value: str) -> Any:
    return ctypes.byref(ctypes.c_char(value.encode()))


_ONE, _MINUS = ctypes.byref(ctypes.c_double(1.0)), ctypes.byref(ctypes.c_double(-1.0))


def cholesky(n: int, a: int, lda: int) -> bool:
    """Factor the lower triangle of A (n, n) in place; return whether A is positive definite."""
    if n <= LARGEST:
        info = ctypes.c_int(0)
        _routine("cython_lapack", "dpotrf", 5)(_letter("L"), _integer(n), a, _integer(lda), ctypes.byref(info))
        return info.value == 0
    half = n // 2
    left, right = a + 8 * half, a + 8 * half * (lda + 1)
    if not cholesky(half, a, lda):
        return False
    divide("R", "T", n - half, half, a, lda, left, lda)
    subtract_square(n - half, half, left, lda, right, lda)
    return cholesky(n - half, right, lda)


def divide(side: str, turned: str, m: int, n: int, a: int, lda: int, b: int, ldb: int) -> None:  # noqa: PLR0917
    """Set B (m, n) to L^-1 B (side "L") or B L^-1 (side "R"), or with L^T (turned "T"), L lower triangular in A."""
    if side == "L" and n <= FEW:
        solve = _routine("cython_blas", "dtrsv", 8)
        for column in range(n):
            at = b + 8 * column * ldb
            solve(_letter("L"), _letter(turned), _letter("N"), _integer(m), a, _integer(lda), at, _integer(1))
        return
    _routine("cython_blas", "dtrsm", 11)(
        _letter(side), _letter("L"), _letter(turned), _letter("N"), _integer(m), _integer(n), _ONE,
        a, _integer(lda), b, _integer(ldb),
    )  # fmt: skip


def subtract_square(n: int, k: int, a: int, lda: int, c: int, ldc: int) -> None:  # noqa: PLR0917
    """Take A A^T from the lower triangle of C (n, n), A (n, k)."""
    _routine("cython_blas", "dsyrk", 10)(
        _letter("L"), _letter("N"), _integer(n), _integer(k), _MINUS, a, _integer(lda), _ONE, c, _integer(ldc)
    )


def subtract_product(  # noqa: PLR0917
    turned: str, m: int, n: int, k: int, a: int, lda: int, b: int, ldb: int, c: int, ldc: int
) -> None:
    """Take op(A) B from C (m, n), op(A) (m, k) being A or (turned "T") A^T, B (k, n)."""
    if n <= FEW:
        multiply, rows, columns = _routine("cython_blas", "dgemv", 11), (m, k)[turned == "T"], (k, m)[turned == "T"]
        for column in range(n):
            multiply(
                _letter(turned), _integer(rows), _integer(columns), _MINUS, a, _integer(lda),
                b + 8 * column * ldb, _integer(1), _ONE, c + 8 * column * ldc, _integer(1),
            )  # fmt: skip
        return
    _routine("cython_blas", "dgemm", 13)(
        _letter(turned), _letter("N"), _integer(m), _integer(n), _integer(k), _MINUS,
        a, _integer(lda), b, _integer(ldb), _ONE, c, _integer(ldc),
    )  # fmt: skip
