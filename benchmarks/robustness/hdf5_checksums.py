"""Checksums of HDF5's structures of version 2, mended after a change.

Each begins with a signature and ends with Jenkins' lookup3 of all before it. A change that leaves
it as it was is refused before anything else is read, and so attacks nothing.

Source: HDF5 File Format Specification 3.0; R. J. Jenkins, lookup3.c (2006).
"""

import struct
from functools import cache
from typing import Any

import numpy as np

# what HDF5 begins its structures of version 2 with, and its first block
SIGNATURES = (
    *(b"\x89HDF\r\n\x1a\n", b"OHDR", b"OCHK", b"BTHD", b"BTLF", b"BTIN", b"FRHP", b"FHDB", b"FHIB"),
    *(b"FSHD", b"FSSE", b"FAHD", b"FADB", b"EAHD", b"EAIB", b"EASB", b"EADB", b"SMTB", b"SMLI"),
)
_BITS = 2**32 - 1
_LONGEST = 2200  # [byte] of a structure


def lookup3(content: bytes) -> int:
    """Jenkins' hash of 32 bits, as HDF5 has it.

    >>> hex(lookup3(b"Four score and seven years ago"))
    '0x17770551'
    """
    a = b = c = 0xDEADBEEF + len(content) & _BITS
    blocks = -(-len(content) // 12)
    words = struct.unpack(f"<{3 * blocks}I", content.ljust(12 * blocks, b"\0"))
    for k in range(0, 3 * blocks, 3):
        plus = a + words[k], b + words[k + 1], c + words[k + 2]
        a, b, c = _mix(*plus) if k < 3 * blocks - 3 else _final(*plus)
    return c


def mended(changed: bytes, original: bytes) -> bytes:
    """A changed file of the same length, with the checksums that its structures should have now."""
    if len(changed) != len(original):
        return changed
    result = bytearray(changed)
    for start, stop, at in structures(original):
        kept = changed[at : at + 4] == original[at : at + 4]
        if kept and changed[start:stop] != original[start:stop]:
            result[at : at + 4] = lookup3(_without(changed, start, stop, at)).to_bytes(4, "little")
    return bytes(result)


def _without(content: bytes, start: int, stop: int, at: int) -> bytes:
    """A structure, in which its own checksum counts as zero."""
    return (
        content[start:stop] if at >= stop else content[start:at] + bytes(4) + content[at + 4 : stop]
    )


@cache
def structures(content: bytes) -> list[tuple[int, int, int]]:
    """Where structures with a checksum begin and end, and where it is."""
    places = []
    for mark in SIGNATURES:
        at = -1
        while (at := content.find(mark, at + 1)) >= 0:
            part = content[at : at + _LONGEST]
            lengths = np.arange(8, len(part) - 3)
            hashes = _of_lengths(part, lengths)
            stored = np.lib.stride_tricks.sliding_window_view(np.frombuffer(part, np.uint8), 4)
            stored = stored[lengths].astype(np.uint32) @ (1 << np.arange(0, 32, 8, dtype=np.uint32))
            places += [(at, at + int(n), at + int(n)) for n in lengths[hashes == stored][:1]]
    for at in (k for k in range(len(content)) if content[k : k + 4] == b"FHDB"):  # inside of it
        for size in (512, 1024, 2048, 4096):
            own = content[at + 17 : at + 21]
            if own == lookup3(_without(content, at, at + size, at + 17)).to_bytes(4, "little"):
                places.append((at, at + size, at + 17))
                break
    return places


def _of_lengths(content: bytes, lengths: np.ndarray) -> np.ndarray:
    """The hash of the first so many bytes, for each of many lengths at once."""
    padded = np.frombuffer(content.ljust(-(-len(content) // 12) * 12 + 12, b"\0"), np.uint8)
    a = (0xDEADBEEF + lengths).astype(np.uint32)
    b, c = a.copy(), a.copy()
    blocks = -(-lengths // 12)  # the last of them, which may be whole, is mixed in another way
    for k in range(int(blocks.max())):
        held = np.arange(12 * k, 12 * k + 12) < lengths[:, None]
        words = np.where(held, padded[12 * k : 12 * k + 12], 0).astype("<u1").view("<u4")
        plus = [a + words[:, 0], b + words[:, 1], c + words[:, 2]]
        inner, last = _mix(*plus), _final(*plus)
        here = [(blocks - 1 > k, inner), (blocks - 1 == k, last)]
        for which, (x, y, z) in here:
            a, b, c = np.where(which, x, a), np.where(which, y, b), np.where(which, z, c)
    return c


def _turn(x: Any, k: int) -> Any:
    return (x << k & _BITS) | (x >> 32 - k)


def _mix(a: Any, b: Any, c: Any) -> tuple[Any, Any, Any]:
    a, b, c = a & _BITS, b & _BITS, c & _BITS
    for k in (4, 6, 8, 16, 19, 4):
        a = (a - c & _BITS) ^ _turn(c, k)
        c = c + b & _BITS
        a, b, c = b, c, a
    return a, b, c


def _final(a: Any, b: Any, c: Any) -> tuple[Any, Any, Any]:
    a, b, c = a & _BITS, b & _BITS, c & _BITS
    for k in (14, 11, 25, 16, 4, 14, 24):
        c = (c ^ b) - _turn(b, k) & _BITS
        a, b, c = b, c, a
    return c, a, b
