"""From a scan file to images: facts of the scan, automatic choices, reconstruction."""

from .acoustics import shares_by_speed
from .acquisition import with_facts
from .body_estimate import BodyEstimate, estimate_body, estimate_ellipse
from .choices import Choices
from .choosing import choose
from .deviations import standard_deviations
from .errors_of_images import ImageErrors, image_errors
from .frames import integrals, setup_of
from .images import ScanImages, reconstruct, reconstruct_file
from .info import describe
from .method import with_best_method
from .parameter_export import as_json, to_look_at
from .parameter_sweep import trials
from .start_time import Start, start_and_speed

__all__ = [
    "BodyEstimate",
    "Choices",
    "ImageErrors",
    "ScanImages",
    "Start",
    "as_json",
    "choose",
    "describe",
    "estimate_body",
    "estimate_ellipse",
    "image_errors",
    "integrals",
    "reconstruct",
    "reconstruct_file",
    "setup_of",
    "shares_by_speed",
    "standard_deviations",
    "start_and_speed",
    "to_look_at",
    "trials",
    "with_best_method",
    "with_facts",
]
