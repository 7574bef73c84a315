"""jaxtat: thermo- and photoacoustic tomography with detectors on an open curve, in JAX."""

from . import phantoms
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
    visibility,
)
from .io import load_plan, save_plan
from .plan import PAPER_K, AccuracyWarning, ReconstructionPlan, build_plan
from .pressure import condition_record, pressure_to_circular_integrals
from .reconstruction import cosine_filter, reconstruct
from .regularization import FixedRank, NormBound, SingularValueCutoff

__all__ = [
    "PAPER_K",
    "AccuracyWarning",
    "DetectorCurve",
    "FixedRank",
    "ImageGrid",
    "NormBound",
    "ReconstructionPlan",
    "Region",
    "SingularValueCutoff",
    "VisibilityWarning",
    "build_plan",
    "circular_arc",
    "circular_integrals",
    "circular_integrals_adjoint",
    "circular_means",
    "condition_record",
    "cosine_filter",
    "data_radii",
    "detector_curve",
    "fit_circle",
    "load_plan",
    "phantoms",
    "pressure_to_circular_integrals",
    "reconstruct",
    "save_plan",
    "truncated_disk",
    "visibility",
]
