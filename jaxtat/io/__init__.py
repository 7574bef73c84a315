"""Files in and out: plans, scans and images."""

from . import datasets as datasets
from .images import load_settings, save_image
from .ipasc import save_ipasc
from .plans import load_plan, save_plan
from .scan import Scan
from .scans import load_scan

__all__ = [
    "Scan",
    "load_plan",
    "load_scan",
    "load_settings",
    "save_image",
    "save_ipasc",
    "save_plan",
]
