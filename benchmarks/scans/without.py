"""Rules of `jaxtat.scans` that can be left out, to see what each is worth: `run.py --without`."""

from collections.abc import Callable

from jaxtat.scans import acoustics, angular_coverage, frames, pipeline, preprocess
from jaxtat.scans.speed_found import unknown


def _start() -> None:
    """No start but the file's."""
    pipeline.start_and_speed = lambda *_: None


def _dip() -> None:
    """From half a circle, no speed by what no image explains."""
    angular_coverage.speed_best_explained = lambda *_: unknown("the rule is left out")


def _least_negative() -> None:
    """From less, no speed by negative values."""
    angular_coverage.speed_least_negative = lambda *_: None


def _faded() -> None:
    """Channels of small gain count."""
    preprocess._without_faded = lambda facts, record, good, p: (good, p)


def _arrivals() -> None:
    """Nothing is said of when sound arrives."""
    acoustics.early_or_late = lambda *_: ""


def _mute() -> None:
    """A muted start counts as it is."""
    frames.without_mute = lambda record: record


RULES: dict[str, Callable[[], None]] = {
    "start": _start,
    "dip": _dip,
    "least-negative": _least_negative,
    "faded": _faded,
    "arrivals": _arrivals,
    "mute": _mute,
}
