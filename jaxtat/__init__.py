"""jaxtat: thermo- and photoacoustic tomography with detectors on an open curve, in JAX."""

# ruff: noqa: F405
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from .version import __version__

if TYPE_CHECKING:
    from .everything import *  # noqa: F403

__all__ = [
    "PAPER_K",
    "AccuracyWarning",
    "DiskBody",
    "FixedRank",
    "ImageGrid",
    "NoiseLevel",
    "NormBound",
    "OutlineBody",
    "Reconstruction",
    "ReconstructionPlan",
    "RelativeCutoff",
    "RelativeTikhonov",
    "Setup",
    "SingularValueCutoff",
    "Tikhonov",
    "TikhonovNormBound",
    "VisibilityWarning",
    "VolumeGrid",
    "__version__",
    "build_plan",
    "circular_arc",
    "circular_means",
    "cosine_filter",
    "data_radii",
    "detector_curve",
    "disk",
    "elliptic_arc",
    "fitting",
    "forward_operator",
    "geometry",
    "io",
    "line_detectors",
    "live",
    "model_based",
    "phantoms",
    "polygon",
    "polyline",
    "reconstruct",
    "reconstruct_file",
    "reconstruct_stack",
    "records",
    "report",
    "scanners",
    "scans",
    "solve",
    "spherical",
    "studies",
    "view",
]


def __getattr__(name: str) -> Any:
    """Imported when the first of it is asked for, since ``jaxtat --help`` needs no JAX."""
    if not name.startswith("_") and find_spec(f".{name}", __name__):
        return import_module(f".{name}", __name__)
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    everything = vars(import_module(".everything", __name__))
    globals().update({public: everything[public] for public in __all__ if public in everything})
    return globals()[name]


def __dir__() -> list[str]:
    return __all__
