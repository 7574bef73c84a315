"""All that `import jaxtat` gives. In a module of its own since it needs JAX: see `jaxtat`."""

# ruff: noqa: F401
from . import datasets, line_detectors, phantoms, scanners, spherical
from .autofocus import sharpness, sound_speed_by_sharpness
from .calibration import Calibration, calibrate
from .channels import ChannelQuality, channel_quality
from .comparison import compare_regularizations
from .diagnostics import data_residual, diagnose
from .forward import circular_integrals, circular_integrals_adjoint, circular_means
from .geometry import (
    DetectorCurve,
    ImageGrid,
    Region,
    VisibilityWarning,
    VolumeGrid,
    circular_arc,
    data_radii,
    detector_curve,
    edge_weight,
    elliptic_arc,
    fit_circle,
    join_curves,
    keep_detectors,
    parametric_curve,
    polygon,
    polyline,
    rectangle,
    transverse_weight,
    truncated_disk,
    turned_views,
    union_of_regions,
    visibility,
    visibility_map,
)
from .harmonic import NoiseLevel
from .impulse_response import remove_impulse_response
from .io import load_plan, load_settings, save_image, save_plan
from .iterative import IterativeReconstruction, least_squares, total_variation
from .layout import Layout, problem_layout
from .line_detectors import LineDetectorScan, reconstruct_volume, reconstruct_volume_stack
from .measured import Choices, ScanImages, choices_for, reconstruct_file, reconstruct_scan
from .noise import NoiseChoice, choose_regularization, image_power
from .noise_law import predict_noise
from .plan import PAPER_K, ReconstructionPlan, build_plan
from .pressure import condition_record, pressure_to_circular_integrals
from .pressure_simulation import circular_integrals_to_pressure
from .problem import AccuracyWarning
from .reconstruction import (
    DirectReconstruction,
    cosine_filter,
    reconstruct,
    reconstruct_direct,
    reconstruct_stack,
)
from .record_noise import RecordNoise, noise_of_record, record_noise_level
from .regularization import (
    FixedRank,
    NormBound,
    RelativeCutoff,
    RelativeTikhonov,
    ResidualTarget,
    SingularValueCutoff,
    Tikhonov,
    TikhonovNormBound,
)
from .reporting import report
from .sampling import Supported, first_arrival, supported
from .uncertainty import pixel_standard_deviation
from .unit_norm import microlocal_norm
