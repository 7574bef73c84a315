"""Images with constraints: the least misfit plus penalty, f >= 0 if asked."""

from .bootstrap import NINETY, fitted_deviation
from .cancelling import FitCancelled, cancelled_by
from .comparison import Comparison, compare_fits
from .fit import ModelBased, model_based
from .penalties import (
    NoPenalty,
    Penalty,
    Ridge,
    SecondOrderVariation,
    TotalVariation,
)

__all__ = [
    "NINETY",
    "Comparison",
    "FitCancelled",
    "ModelBased",
    "NoPenalty",
    "Penalty",
    "Ridge",
    "SecondOrderVariation",
    "TotalVariation",
    "cancelled_by",
    "compare_fits",
    "fitted_deviation",
    "model_based",
]
