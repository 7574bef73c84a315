"""Files in and out: plans, scans and images."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import datasets as datasets
    from .images import load_settings, save_image
    from .ipasc import save_ipasc
    from .plans import load_plan, save_plan
    from .scan import Scan
    from .scan_files import load_response, load_scan

_MODULES = {
    "Scan": "scan",
    "load_plan": "plans",
    "load_response": "scan_files",
    "load_scan": "scan_files",
    "load_settings": "images",
    "save_image": "images",
    "save_ipasc": "ipasc",
    "save_plan": "plans",
}
__all__ = [
    "Scan",
    "load_plan",
    "load_response",
    "load_scan",
    "load_settings",
    "save_image",
    "save_ipasc",
    "save_plan",
]


def __getattr__(name: str) -> Any:
    """Imported when it is asked for, since the process that opens files needs no JAX."""
    if name in _MODULES:
        return getattr(import_module(f".{_MODULES[name]}", __name__), name)
    if name == "datasets":
        return import_module(".datasets", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "datasets"]
