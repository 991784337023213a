"""The compiled loops of the reader: over a chunk's records, and over fixed-length messages."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]


@njit(cache=True, nogil=True)
def _integer(buffer: Bytes, at: int, size: int) -> np.uint64:
    value = np.uint64(0)
    for i in range(size - 1, -1, -1):
        value = (value << np.uint64(8)) | np.uint64(buffer[at + i])
    return value


@njit(cache=True, nogil=True)
def walk(  # noqa: PLR0917, compiled functions take arrays, not objects
    buffer: Bytes,
    channel: NDArray[np.uint16],
    stamp: Integers,
    offset: Integers,
    length: Integers,
    others: Integers,
) -> tuple[int, int, int]:
    """Fill in where messages stand, and where other records begin.

    Returns how many of each, and where the first record begins that is not whole.
    """
    at, count, rest, size = 0, 0, 0, len(buffer)
    while at + 9 <= size:
        content = _integer(buffer, at + 1, 8)
        if content > np.uint64(size - at - 9):
            break
        if buffer[at] == 0x05:
            if content < np.uint64(22):
                break
            channel[count] = _integer(buffer, at + 9, 2)
            stamp[count] = np.int64(_integer(buffer, at + 15, 8))
            offset[count] = at + 31
            length[count] = np.int64(content) - 22
            count += 1
        else:
            if rest == len(others):
                break
            others[rest] = at
            rest += 1
        at += 9 + int(content)
    return count, rest, at


@njit(cache=True, nogil=True)
def gather(buffer: Bytes, offset: Integers, tags: Bytes, widths: Integers, out: Bytes) -> int:
    """Copy the doubles that follow each tag of each message into `out`; return a message that differs, or -1."""
    fields = len(widths)
    for i in range(len(offset)):
        at = int(offset[i])
        tag = 0
        for j in range(fields):
            for _ in range(widths[j]):
                if buffer[at] != tags[tag]:
                    return i
                at += 1
                tag += 1
            to = (i * fields + j) * 8
            for k in range(8):
                out[to + k] = buffer[at + k]
            at += 8
    return -1
