"""How much to keep: rules, what they mean for singular values and alpha, and norms."""

from .alpha import (
    NoiseLevel,
    Problem,
    RelativeTikhonov,
    ResidualTarget,
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
    seen_once,
)
from .unit_norm import microlocal_norm, unit_norms

__all__ = [
    "DEFAULT_KAPPA",
    "SINGULAR",
    "FixedRank",
    "NoiseLevel",
    "NormBound",
    "Problem",
    "Regularization",
    "RelativeCutoff",
    "RelativeTikhonov",
    "ResidualTarget",
    "SingularValueCutoff",
    "Tikhonov",
    "TikhonovNormBound",
    "TikhonovRule",
    "microlocal_norm",
    "per_frequency",
    "seen_once",
    "singular_components",
    "tikhonov_rule",
    "unit_norms",
]
