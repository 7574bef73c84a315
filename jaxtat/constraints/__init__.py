"""Images with constraints: what data leave open, a penalty decides."""

from .comparison import Comparison, compare_fits
from .fit import ModelBased, model_based
from .penalties import (
    NoPenalty,
    Penalty,
    Ridge,
    SecondOrderVariation,
    TotalVariation,
    Wavelets,
)

__all__ = [
    "Comparison",
    "ModelBased",
    "NoPenalty",
    "Penalty",
    "Ridge",
    "SecondOrderVariation",
    "TotalVariation",
    "Wavelets",
    "compare_fits",
    "model_based",
]
