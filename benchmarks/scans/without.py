"""Rules of `jaxtat.scans`, each of which can be left out: `run.py --ablation`."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple
from unittest.mock import patch

from jaxtat.scans import (
    acoustics,
    acoustics_in_space,
    frames,
    onset_times,
    pipeline,
    preprocess,
    region,
    resolution,
)
from jaxtat.scans import angular_coverage as coverage
from jaxtat.scans.speed_found import unknown


class Rule(NamedTuple):
    """A name in a module, and what stands there without the rule.

    Attributes:
        says: in a few words.
        module, name: where it is.
        without: the value that leaves it out; of functions one of the function itself.
    """

    says: str
    module: Any
    name: str
    without: Any

    @contextmanager
    def left_out(self) -> Iterator[None]:
        with patch.object(self.module, self.name, self._other(getattr(self.module, self.name))):
            yield

    @contextmanager
    def watched(self) -> Iterator[Callable[[], bool]]:
        """Whether the rule was asked; always of constants."""
        if not callable(getattr(self.module, self.name)):
            yield lambda: True
            return
        own = getattr(self.module, self.name)
        with patch.object(self.module, self.name, side_effect=own) as calls:
            yield lambda: calls.called

    def _other(self, own: Any) -> Any:
        return self.without(own) if callable(own) else self.without


def _always(value: Any) -> Callable[[Any], Any]:
    return lambda _: lambda *args, **names: value


RULES = {
    "start": Rule("start by images", pipeline, "start_and_speed", _always(None)),
    "dip": Rule(
        "speed by what no image explains, from half a circle",
        coverage,
        "speed_best_explained",
        _always(unknown("the rule is left out")),
    ),
    "least-negative": Rule(
        "speed by negative values, from less", coverage, "speed_least_negative", _always(None)
    ),
    "opposite": Rule(
        "speed by opposite detectors, in space",
        acoustics_in_space,
        "speed_in_space",
        _always(unknown("the rule is left out")),
    ),
    "arrivals": Rule("when sound may arrive", acoustics, "early_or_late", _always("")),
    "artefact": Rule("end of the laser's artefact", preprocess, "artefact_ends", _always(0.0)),
    "mute": Rule("muted start", frames, "without_mute", lambda _: lambda record: record),
    "muted-until": Rule("silence before sound", preprocess, "muted_until", _always(float("-inf"))),
    "faded": Rule(
        "channels of small gain",
        preprocess,
        "_without_faded",
        lambda _: lambda facts, record, good, p: (good, p),
    ),
    "walls": Rule("sound from walls", onset_times, "sounding_place", _always(None)),
    "opening": Rule(
        "regions cut at the arc's opening",
        region,
        "_cut_at_opening",
        lambda own: lambda arc, p, beyond=0.0: own(arc, p, float("inf")),
    ),
    "finer": Rule("waves finer than the spacing", resolution, "FINER", 1.0),
}
