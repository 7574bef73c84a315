"""From a scan file to images: facts of the scan, automatic choices, reconstruction."""

from .choices import Choices
from .choosing import choose, estimate
from .deviations import standard_deviations
from .facts import with_facts
from .frames import integrals, setup_of
from .graded import as_json, to_look_at
from .images import ScanImages, reconstruct, reconstruct_file
from .info import describe
from .method import with_best_method
from .speed import estimate_sound_speed
from .trying import trials

__all__ = [
    "Choices",
    "ScanImages",
    "as_json",
    "choose",
    "describe",
    "estimate",
    "estimate_sound_speed",
    "integrals",
    "reconstruct",
    "reconstruct_file",
    "setup_of",
    "standard_deviations",
    "to_look_at",
    "trials",
    "with_best_method",
    "with_facts",
]
