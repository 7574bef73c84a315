"""Choices in the making, and what those in the plane and in space have in common."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from .choices import Choices

DEFAULT_SHARE = 0.75  # of the detectors' radius, where the record does not tell
RIM = 0.95  # of the detectors' radius, up to which sources are reckoned with
ALPHAS = (1e-6, 1e-1)
CLEAN = 1e-5  # alpha below which no low-pass filter is needed
INTEGRALS_ALPHA = 1e-6


class Found(NamedTuple):
    """Choices as they are made: what was given counts."""

    given: Mapping[str, Any]
    values: dict[str, Any]
    reasons: dict[str, str]

    def take(self, name: str, value: Any, reason: str) -> Any:
        if self.given.get(name) is not None:
            value, reason = self.given[name], "given"
        self.values[name], self.reasons[name] = value, reason
        return value

    def choices(self) -> Choices:
        """All of them, once all were taken."""
        return Choices.from_settings(self.values | {"reasons": tuple(self.reasons.items())})
