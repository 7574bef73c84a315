"""Files in and out: plans, scans and images."""

from .images import save_image
from .plans import load_plan, save_plan
from .scans import Scan, load_scan

__all__ = ["Scan", "load_plan", "load_scan", "save_image", "save_plan"]
