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
    "Calibration",
    "ChannelQuality",
    "DetectorCurve",
    "FixedRank",
    "ImageGrid",
    "IterativeReconstruction",
    "NoiseChoice",
    "NoiseLevel",
    "NormBound",
    "Reconstruction",
    "ReconstructionPlan",
    "RecordNoise",
    "Region",
    "RelativeCutoff",
    "RelativeTikhonov",
    "ResidualTarget",
    "Setup",
    "SingularValueCutoff",
    "Supported",
    "Tikhonov",
    "TikhonovNormBound",
    "VisibilityWarning",
    "VolumeGrid",
    "__version__",
    "build_plan",
    "calibrate",
    "channel_quality",
    "choose_regularization",
    "circular_arc",
    "circular_integrals",
    "circular_integrals_adjoint",
    "circular_integrals_to_pressure",
    "circular_means",
    "compare_regularizations",
    "condition_record",
    "cosine_filter",
    "data_radii",
    "data_residual",
    "datasets",
    "detector_curve",
    "diagnose",
    "disk",
    "edge_weight",
    "elliptic_arc",
    "first_arrival",
    "fit_circle",
    "image_power",
    "join_curves",
    "keep_detectors",
    "least_squares",
    "line_detectors",
    "load_plan",
    "load_settings",
    "microlocal_norm",
    "noise_of_record",
    "parametric_curve",
    "phantoms",
    "pixel_standard_deviation",
    "polygon",
    "polyline",
    "predict_noise",
    "pressure_to_circular_integrals",
    "reconstruct",
    "reconstruct_file",
    "reconstruct_stack",
    "record_noise_level",
    "records",
    "rectangle",
    "remove_impulse_response",
    "report",
    "save_image",
    "save_plan",
    "scanners",
    "scans",
    "sharpness",
    "solve",
    "sound_speed_by_sharpness",
    "spherical",
    "studies",
    "supported",
    "total_variation",
    "transverse_weight",
    "turned_views",
    "union_of_regions",
    "visibility",
    "visibility_map",
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
