"""How much to keep: rules, what they mean for singular values and alpha, and norms."""

from .alpha import (
    FrequencyData,
    NoiseLevel,
    RelativeTikhonov,
    Tikhonov,
    TikhonovNormBound,
    TikhonovRule,
    tikhonov_rule,
)
from .filtered import SINGULAR, singular_components
from .rules import (
    DEFAULT_KAPPA,
    FixedRank,
    NormBound,
    Regularization,
    RelativeCutoff,
    SingularValueCutoff,
    per_frequency,
    single_crossing,
)
from .solutions import SolveReport, relative_residual, report_of, spectrum, tikhonov_solution
from .unit_norm import microlocal_norm, unit_norms

__all__ = [
    "DEFAULT_KAPPA",
    "SINGULAR",
    "FixedRank",
    "FrequencyData",
    "NoiseLevel",
    "NormBound",
    "Regularization",
    "RelativeCutoff",
    "RelativeTikhonov",
    "SingularValueCutoff",
    "SolveReport",
    "Tikhonov",
    "TikhonovNormBound",
    "TikhonovRule",
    "microlocal_norm",
    "per_frequency",
    "relative_residual",
    "report_of",
    "single_crossing",
    "singular_components",
    "spectrum",
    "tikhonov_rule",
    "tikhonov_solution",
    "unit_norms",
]
