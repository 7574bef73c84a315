"""jaxtat: thermo- and photoacoustic tomography with detectors on an open curve, in JAX."""

from . import phantoms
from .calibration import Calibration, calibrate
from .comparison import compare_regularizations
from .forward import circular_integrals, circular_integrals_adjoint, circular_means
from .geometry import (
    DetectorCurve,
    ImageGrid,
    Region,
    VisibilityWarning,
    circular_arc,
    data_radii,
    detector_curve,
    fit_circle,
    truncated_disk,
    turned_views,
    visibility,
)
from .harmonic import NoiseLevel
from .io import load_plan, save_plan
from .iterative import IterativeReconstruction, least_squares, total_variation
from .layout import Layout, problem_layout
from .noise import NoiseChoice, choose_regularization, image_power
from .plan import PAPER_K, ReconstructionPlan, build_plan
from .pressure import condition_record, pressure_to_circular_integrals
from .problem import AccuracyWarning
from .reconstruction import (
    DirectReconstruction,
    cosine_filter,
    reconstruct,
    reconstruct_direct,
    reconstruct_stack,
)
from .regularization import (
    FixedRank,
    NormBound,
    SingularValueCutoff,
    Tikhonov,
    TikhonovNormBound,
)
from .sharpness import sharpness, sound_speed_by_sharpness
from .uncertainty import pixel_standard_deviation

__all__ = [
    "PAPER_K",
    "AccuracyWarning",
    "Calibration",
    "DetectorCurve",
    "DirectReconstruction",
    "FixedRank",
    "ImageGrid",
    "IterativeReconstruction",
    "Layout",
    "NoiseChoice",
    "NoiseLevel",
    "NormBound",
    "ReconstructionPlan",
    "Region",
    "SingularValueCutoff",
    "Tikhonov",
    "TikhonovNormBound",
    "VisibilityWarning",
    "build_plan",
    "calibrate",
    "choose_regularization",
    "circular_arc",
    "circular_integrals",
    "circular_integrals_adjoint",
    "circular_means",
    "compare_regularizations",
    "condition_record",
    "cosine_filter",
    "data_radii",
    "detector_curve",
    "fit_circle",
    "image_power",
    "least_squares",
    "load_plan",
    "phantoms",
    "pixel_standard_deviation",
    "pressure_to_circular_integrals",
    "problem_layout",
    "reconstruct",
    "reconstruct_direct",
    "reconstruct_stack",
    "save_plan",
    "sharpness",
    "sound_speed_by_sharpness",
    "total_variation",
    "truncated_disk",
    "turned_views",
    "visibility",
]
