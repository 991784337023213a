"""Decimal numbers to the nearest double, in compiled code: D. Lemire, Software: Pract. Exper. 51 (2021) 1700.

A number is its digits as an integer times a power of ten; the product with the power's first 128
bits decides the rounding. What it cannot decide (more than 19 digits, subnormals, overflow, ties
beyond the table) is left to the caller, who asks Python.
"""

from functools import cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]
Words = NDArray[np.uint64]

LEAST, MOST = -342, 308  # beyond these powers of ten, 19 digits are zero or infinite
_U = np.uint64
_LOW = np.uint64(0xFFFFFFFF)
_ONE = np.uint64(1)


@cache
def powers() -> Words:
    """Return (651, 2): the first 128 bits of 5^q for q = -342..308, high and low word; cut off, not rounded."""
    words = np.empty((MOST - LEAST + 1, 2), np.uint64)
    for q in range(LEAST, MOST + 1):
        five = 5 ** abs(q)
        if q >= 0:
            shift = 128 - five.bit_length()
            bits = five << shift if shift >= 0 else five >> -shift
        else:  # the reciprocal, rounded up
            size = (five - 1).bit_length()
            bits = (1 << (size + 127 if q >= -27 else 2 * size + 128)) // five + 1
            bits >>= max(0, bits.bit_length() - 128)
        words[q - LEAST] = bits >> 64, bits & (1 << 64) - 1
    return words


@njit(cache=True, nogil=True, inline="always")
def _product(a: np.uint64, b: np.uint64) -> tuple[np.uint64, np.uint64]:
    """Return the high and low word of a * b."""
    shift = _U(32)
    a_low, a_high, b_low, b_high = a & _LOW, a >> shift, b & _LOW, b >> shift
    low, middle, other = a_low * b_low, a_high * b_low, a_low * b_high
    carry = (low >> shift) + (middle & _LOW) + (other & _LOW)
    return a_high * b_high + (middle >> shift) + (other >> shift) + (carry >> shift), a * b


@njit(cache=True, nogil=True)
def _nearest(digits: np.uint64, q: int, power: np.uint64, power_rest: np.uint64) -> np.uint64:
    """Return the bits of the double nearest to digits * 10^q > 0; 0 where that is not certain. Powers: words of 5^q."""
    zeros = 0
    while digits & (_ONE << _U(63)) == 0:
        digits <<= _ONE
        zeros += 1
    high, low = _product(digits, power)
    if high & _U(0x1FF) == _U(0x1FF):
        more, _ = _product(digits, power_rest)
        low += more
        if low < more:
            high += _ONE
    if low == ~_U(0) and (q < -27 or q > 55):
        return _U(0)
    upper = high >> _U(63)
    shift = upper + _U(9)
    mantissa = high >> shift
    exponent = ((217706 * q) >> 16) + 63 + int(upper) - zeros + 1023
    if exponent <= 0:
        return _U(0)
    if low <= _ONE and -4 <= q <= 23 and mantissa & _U(3) == _ONE and mantissa << shift == high:
        mantissa &= ~_ONE  # a tie: to even
    mantissa = (mantissa + (mantissa & _ONE)) >> _ONE
    if mantissa >= _ONE << _U(53):
        mantissa = _ONE << _U(52)
        exponent += 1
    if exponent >= 0x7FF:
        return _U(0)
    return (mantissa & ~(_ONE << _U(52))) | (_U(exponent) << _U(52))


@njit(cache=True, nogil=True, inline="always")
def _digits(text: Bytes, at: int, end: int, before: np.uint64) -> tuple[int, np.uint64]:
    """Return where a run of digits ends, and `before` continued by them."""
    while at < end:
        digit = text[at] - np.uint8(48)  # wraps: what stands before "0" becomes large
        if digit > 9:
            break
        before = before * _U(10) + _U(digit)
        at += 1
    return at, before


@njit(cache=True, nogil=True, inline="always")
def number(text: Bytes, at: int, end: int, table: Words) -> tuple[int, np.uint64]:  # noqa: PLR0911, one grammar
    """Read a JSON number from text[at:end]: where it ends (-1: none, or not certain), and its bits."""
    failed, sign = (-1, _U(0)), _U(0)
    if at < end and text[at] == 45:
        sign = _ONE << _U(63)
        at += 1
    first = at
    at, digits = _digits(text, at, end, _U(0))
    if at == first or (at - first > 1 and text[first] == 48):
        return failed
    count, q = at - first, 0
    if at < end and text[at] == 46:
        fraction = at + 1
        at, digits = _digits(text, fraction, end, digits)
        q = fraction - at
        if q == 0:
            return failed
        count -= q
    if count > 19:  # zeros before the first digit do not count
        while first < at and (text[first] == 48 or text[first] == 46):
            count -= text[first] == 48
            first += 1
        if count > 19:
            return failed
    if at < end and text[at] | 32 == 101:
        at += 1
        minus = at < end and text[at] == 45
        if at < end and (text[at] == 45 or text[at] == 43):
            at += 1
        at, power = _digits(text, at, min(end, at + 5), _U(0))
        if not 48 <= text[at - 1] <= 57 or (at < end and 48 <= text[at] <= 57):
            return failed
        q += -int(power) if minus else int(power)
    if digits == _U(0):
        return at, sign
    if not LEAST <= q <= MOST:
        return failed
    bits = _nearest(digits, q, table[q - LEAST, 0], table[q - LEAST, 1])
    return (at, bits | sign) if bits else failed
