"""Choices in the making, and what those in the plane and in space have in common."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

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

    def take_alpha(self, ratio: float, how: str) -> None:
        """alpha and low pass by the power of the noise over that of the sound, and how it is known.

        Args:
            ratio: as in Wiener's filter; alpha is kept within `ALPHAS`.
            how: words that follow the number.
        """
        least, most = ALPHAS
        kept = "raised to the least: " if ratio < least else "capped: " if ratio > most else ""
        why = f"{kept}noise over signal power {ratio:.2g}, {how}"
        alpha = float(self.take("alpha", float(np.clip(ratio, least, most)), why))
        noisy = alpha > CLEAN
        why = "noise" if noisy else "hardly any noise"
        self.take("low_pass", "cosine" if noisy else "none", why)

    def choices(self) -> Choices:
        """All of them, once all were taken."""
        return Choices.from_settings(self.values | {"reasons": tuple(self.reasons.items())})
