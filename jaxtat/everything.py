"""All that `import jaxtat` gives. In a module of its own since it needs JAX: see `jaxtat`."""

# ruff: noqa: F401
from . import line_detectors, phantoms, records, scans, spherical, studies
from .base import scanners
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
from .io import datasets, load_plan, load_settings, save_image, save_plan
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
from .records import (
    ChannelQuality,
    RecordNoise,
    Supported,
    channel_quality,
    circular_integrals_to_pressure,
    condition_record,
    first_arrival,
    noise_of_record,
    pressure_to_circular_integrals,
    record_noise_level,
    remove_impulse_response,
    supported,
)
from .regularization import (
    FixedRank,
    NoiseLevel,
    NormBound,
    RelativeCutoff,
    RelativeTikhonov,
    ResidualTarget,
    SingularValueCutoff,
    Tikhonov,
    TikhonovNormBound,
    microlocal_norm,
)
from .reporting import report
from .scans import reconstruct_file
from .steps import AccuracyWarning, cosine_filter
from .studies import (
    Calibration,
    IterativeReconstruction,
    NoiseChoice,
    calibrate,
    choose_regularization,
    compare_regularizations,
    data_residual,
    diagnose,
    image_power,
    least_squares,
    pixel_standard_deviation,
    predict_noise,
    sharpness,
    sound_speed_by_sharpness,
    total_variation,
    visibility_map,
)
