"""Fits that end early because nobody waits for them; until then they say how far they are."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any


class FitCancelled(Exception):
    """A fit within `cancelled_by` that ended before its image was found."""


_ASKED: ContextVar[Callable[[], bool] | None] = ContextVar("_ASKED", default=None)
_TOLD: ContextVar[Callable[[str], Any] | None] = ContextVar("_TOLD", default=None)


@contextmanager
def cancelled_by(
    asked: Callable[[], bool], told: Callable[[str], Any] | None = None
) -> Iterator[None]:
    """Fits of this thread look every few steps whether they are still wanted.

    Not an argument of `model_based`, since functions lie between who waits and who fits that know
    of neither.

    Args:
        asked: whether the fit is to end; may look at what another thread sets.
        told: gets a line on how far the fit is, every few steps; by default nothing does.

    Raises:
        FitCancelled: from within, once it says so.

    >>> from jaxtat import ImageGrid, Setup, circular_arc, disk, model_based
    >>> setup = Setup(circular_arc(1.3, 1.0, 30), disk(1.0), ImageGrid(21), max_frequency=20.0)
    >>> try:
    ...     with cancelled_by(lambda: True):
    ...         model_based(setup, setup.curve.points[:, :1] + setup.radii)
    ... except FitCancelled:
    ...     print("not wanted")
    not wanted
    """
    before, told_before = _ASKED.set(asked), _TOLD.set(told)
    try:
        yield
    finally:
        _ASKED.reset(before)
        _TOLD.reset(told_before)


def can_be_cancelled() -> bool:
    """Whether fits run within `cancelled_by`."""
    return _ASKED.get() is not None


def require_wanted() -> None:
    """Raise FitCancelled if the fit is not wanted any more."""
    asked = _ASKED.get()
    if asked is not None and asked():
        raise FitCancelled


def tell(line: str) -> None:
    """Say to who waits for the fit how far it is."""
    told = _TOLD.get()
    if told is not None:
        told(line)
