"""All that `import jaxtat` gives. In a module of its own since it needs JAX: see `jaxtat`."""

# ruff: noqa: F401
from . import datasets, line_detectors, phantoms, scanners, spherical
from .autofocus import sharpness, sound_speed_by_sharpness
from .calibration import Calibration, calibrate
from .channels import ChannelQuality, channel_quality
from .comparison import compare_regularizations
from .diagnostics import data_residual, diagnose
from .geometry import (
    DetectorCurve,
    ImageGrid,
    Region,
    VisibilityWarning,
    VolumeGrid,
    circular_arc,
    data_radii,
    detector_curve,
    disk,
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
    turned_views,
    union_of_regions,
    visibility,
)
from .harmonic import NoiseLevel, RelativeTikhonov, Tikhonov, TikhonovNormBound
from .impulse_response import remove_impulse_response
from .io import load_plan, load_settings, save_image, save_plan
from .iterative import IterativeReconstruction, least_squares, total_variation
from .measured import reconstruct_file
from .noise_choice import NoiseChoice, choose_regularization, image_power
from .noise_law import predict_noise
from .pressure import condition_record, pressure_to_circular_integrals
from .pressure_simulation import circular_integrals_to_pressure
from .problem import AccuracyWarning
from .reconstruction import (
    PAPER_K,
    Reconstruction,
    ReconstructionPlan,
    Setup,
    build_plan,
    circular_integrals,
    circular_integrals_adjoint,
    circular_means,
    reconstruct,
    reconstruct_stack,
    solve,
)
from .record_noise import RecordNoise, noise_of_record, record_noise_level
from .regularization import (
    FixedRank,
    NormBound,
    RelativeCutoff,
    ResidualTarget,
    SingularValueCutoff,
)
from .reporting import report
from .sampling import Supported, first_arrival, supported
from .steps import cosine_filter
from .uncertainty import pixel_standard_deviation
from .unit_norm import microlocal_norm
from .visibility_map import visibility_map
