"""A scan that a page shows: its frames, and what is said of them."""

from collections.abc import Mapping
from typing import Any

from ..io import Scan
from ..scans import Choices
from ..scans.acquisition import frame_numbers


class ViewedScan:
    """A scan with choices, and facts that options said of it.

    Args:
        scan: its frames may be lazy, and only those that are shown are read.
        choices: of its images.
        facts: what was said of the scan in options of the command, by their names.

    Attributes:
        scan, choices, facts: those.
    """

    def __init__(self, scan: Scan, choices: Choices, facts: Mapping[str, Any] | None):
        self.scan, self.choices, self.facts = scan, choices, dict(facts or {})

    def frame_number(self, frame: int) -> int:
        """Number of a frame in its file."""
        return int(frame_numbers(self.scan)[frame])

    def frame_facts(self, frame: int) -> dict[str, Any]:
        """Facts by which a command takes this frame alone."""
        if self.scan.data.ndim == 2:
            return self.facts
        number = self.frame_number(frame)
        return self.facts | {"frames": f"{number}:{number + 1}"}

    def frame_title(self, frame: int) -> str:
        """Title of the slider: what tells the frame besides its place."""
        number, wavelengths = self.frame_number(frame), self.scan.known.get("wavelengths")
        in_file = "" if number == frame else f" ({number} in the file)"
        of_it = "" if wavelengths is None else f" ({wavelengths[frame]:g} nm)"
        return f"frame{in_file}{of_it}"

    @property
    def about(self) -> str:
        """How large the scan is, in words."""
        n = self.scan.n_frames
        frames = f"{n} frames of " if n > 1 else ""
        return f"{frames}{self.scan.n_detectors} detectors, {self.scan.n_samples} samples"
