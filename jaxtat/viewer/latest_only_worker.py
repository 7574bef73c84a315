"""Computations of a page in a thread of their own: only the latest request is computed."""

import sys
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import jax

from ..fitting import FitCancelled, cancelled_by

Work = Callable[[], Any]
Show = Callable[[Any, str], Any]  # of a result, or of an error in words


class LatestOnlyWorker:
    """Computes the latest request, and skips those that came before it in the meantime.

    Args:
        later: runs a function in the page's own thread, soon; may be called from any thread.
    """

    def __init__(self, later: Callable[[Work], Any]):
        self._later, self._thread = later, ThreadPoolExecutor(1)
        self._must: deque[tuple[Work, Show]] = deque()
        self._wanted: tuple[Work, Show] | None = None
        self._busy = self._closed = False

    def want(self, work: Work, show: Show) -> None:
        """Compute this next, unless a later request replaces it."""
        self._wanted = work, show
        self._begin()

    def must(self, work: Work, show: Show) -> None:
        """Compute this even if later requests come."""
        self._must.append((work, show))
        self._begin()

    def close(self) -> None:
        """Start no further computation."""
        self._closed = True
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _begin(self) -> None:
        if self._busy or self._closed:
            return
        if self._must:
            work, show = self._must.popleft()
        elif self._wanted is not None:
            (work, show), self._wanted = self._wanted, None
        else:
            return
        self._busy = True
        future = self._thread.submit(_in_double, work)
        future.add_done_callback(lambda done: self._done(done, show))

    def _done(self, future: Future, show: Show) -> None:
        """Hand the result over to the page's thread."""
        if not self._closed and not future.cancelled():
            self._later(lambda: self._take(future, show))

    def _take(self, future: Future, show: Show) -> None:
        self._busy, error = False, future.exception()
        self._begin()  # the next is made while this is shown
        if error is None:
            show(future.result(), "")
        else:
            show(None, said(error))


def while_wanted(
    work: Work, unwanted: threading.Event, told: Callable[[str], Any] | None = None
) -> Work:
    """Work that gives None, soon, once its result is unwanted; fits tell how far they are."""

    def work_or_none() -> Any:
        try:
            with cancelled_by(unwanted.is_set, told):
                return None if unwanted.is_set() else work()
        except FitCancelled:
            return None

    return work_or_none


def _in_double(work: Callable[[], Any]) -> Any:
    """Run with 64 bits in this thread, whatever the program uses."""
    with jax.enable_x64(True):
        return work()


def said(error: BaseException) -> str:
    """An error as one line; the place in the program goes to the terminal if it is unexpected."""
    if not isinstance(error, ValueError | OSError):
        sys.excepthook(type(error), error, error.__traceback__)
    return " ".join(str(error).split()) or type(error).__name__
