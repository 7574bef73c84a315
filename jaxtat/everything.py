"""All that `import jaxtat` gives. In a module of its own since it needs JAX: see `jaxtat`."""

# ruff: noqa: F401
from . import (
    fitting,
    geometry,
    io,
    line_detectors,
    phantoms,
    records,
    scans,
    spherical,
    studies,
)
from .base import scanners
from .fitting import model_based
from .geometry import (
    DiskBody,
    ImageGrid,
    OutlineBody,
    VisibilityWarning,
    VolumeGrid,
    circular_arc,
    data_radii,
    detector_curve,
    disk,
    elliptic_arc,
    polygon,
    polyline,
)
from .reconstruction import (
    PAPER_K,
    Reconstruction,
    ReconstructionPlan,
    Setup,
    build_plan,
    circular_means,
    forward_operator,
    reconstruct,
    reconstruct_stack,
    solve,
)
from .regularization import (
    FixedRank,
    NoiseLevel,
    NormBound,
    RelativeCutoff,
    RelativeTikhonov,
    SingularValueCutoff,
    Tikhonov,
    TikhonovNormBound,
)
from .reporting import report
from .scans import reconstruct_file
from .steps import AccuracyWarning, cosine_filter
from .streams import live
from .viewer import view
