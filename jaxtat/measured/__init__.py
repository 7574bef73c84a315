"""From a file to a picture: what a scan tells of itself, what is chosen by it, and the images."""

from .choices import Choices
from .choose import choices_for
from .facts import with_facts
from .frames import Where, integrals
from .images import ScanImages, reconstruct_file, reconstruct_scan
from .info import describe
from .speed import estimate_sound_speed

__all__ = [
    "Choices",
    "ScanImages",
    "Where",
    "choices_for",
    "describe",
    "estimate_sound_speed",
    "integrals",
    "reconstruct_file",
    "reconstruct_scan",
    "with_facts",
]
