"""Limits of memory for what files hold, and messages about files that are refused."""

from collections.abc import Iterator
from contextlib import contextmanager

from ..base.messages import one_line

MAX_BYTES = 2**32  # [byte], what the arrays of one file may take in memory unless the caller says
DEFLATE = 1032  # bytes that one byte of the deflate format gives at most: 258 for two bits, twice


class Allowance:
    """The memory that arrays of one file may still take.

    Args:
        max_bytes: for all of them together [byte].

    >>> allowance = Allowance(1000)
    >>> allowance.take("pressure", 800)
    >>> allowance.take("detectors", 800)
    Traceback (most recent call last):
    ValueError: detectors takes 800 bytes, 200 of max_bytes = 1000 are left: if the file is to be \
trusted, allow more (max_bytes=...).
    """

    def __init__(self, max_bytes: int = MAX_BYTES):
        self.max_bytes = self.left = max_bytes

    def take(self, name: str, nbytes: int) -> None:
        """Count an array that stays, or raise ValueError."""
        self.require(name, nbytes)
        self.left -= nbytes

    def require(self, name: str, nbytes: int) -> None:
        """Raise ValueError for more than is left: of what is only there for a while."""
        if nbytes > self.left:
            raise ValueError(
                f"{name} takes {nbytes} bytes, {self.left} of max_bytes = {self.max_bytes} are "
                "left: if the file is to be trusted, allow more (max_bytes=...)."
            )


def require_held(name: str, claimed: int, held: int, ratio: int = 1) -> None:
    """Raise ValueError if the bytes held by a file, each good for ``ratio``, are too few."""
    if claimed > ratio * held:
        raise ValueError(
            f"{name} claims {claimed} bytes, but the file holds {held} for it: it is cut off, or "
            "its header is damaged."
        )


@contextmanager
def refusing(before: str, damaged: str = "it is damaged", after: str = ".") -> Iterator[None]:
    """Turn any error in the block into a ValueError of one line, `LONGEST_MESSAGE` at most.

    Libraries have errors of their own for damaged files, some of many lines, and with content of
    the file in them. Only what the system refuses (`PermissionError`) stays as it is.

    Args:
        before: what every message begins with.
        damaged: what an error means that is no ValueError; its kind and text follow in brackets.
        after: what every message ends with.

    >>> with refusing("cannot read a.h5: "):
    ...     raise RuntimeError("no such \\n node")
    Traceback (most recent call last):
    ValueError: cannot read a.h5: it is damaged (RuntimeError: no such node).
    """
    try:
        yield
    except PermissionError:
        raise
    except Exception as error:
        reason = str(error)
        if not isinstance(error, ValueError):
            reason = f"{damaged} ({type(error).__name__}: {reason})"
        raise ValueError(one_line(before, reason.rstrip("."), after)) from error
