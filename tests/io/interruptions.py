"""A writer stopped at a chosen line of `jaxtat.io`, or out of room."""

import resource
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import jaxtat.io

_HERE = str(Path(jaxtat.io.__file__).parent)


class _Lines:
    """Counts lines, and at one of them does as Ctrl-C does; elsewhere it might not be heeded."""

    def __init__(self, last: int | None):
        self.last, self.count = last, 0

    def __call__(self, frame: FrameType, event: str, argument: Any) -> "_Lines | None":
        if not frame.f_code.co_filename.startswith(_HERE):
            return None
        if event == "line":
            self.count += 1
            if self.count == self.last:
                raise KeyboardInterrupt
        return self


def lines_of(write: Callable[[], Any], last: int | None = None) -> int:
    """How many lines writing takes; KeyboardInterrupt at line number ``last``, if that is given."""
    lines, before = _Lines(last), sys.gettrace()
    sys.settrace(lines)
    try:
        write()
    finally:
        sys.settrace(before)
    return lines.count


@contextmanager
def files_of_at_most(nbytes: int) -> Iterator[None]:
    """Files cannot grow beyond that, as on a disk that is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (nbytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
