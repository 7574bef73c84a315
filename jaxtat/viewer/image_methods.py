"""How the images of a page are made, and the choices of a scan for each way."""

from collections.abc import Mapping
from dataclasses import replace

from ..base.choice_table import OF_CONSTRAINTS, SURE
from ..scans import Choices

DIRECT, BACK_PROJECTION, MODEL_BASED = METHODS = "direct", "back-projection", "model-based"


def as_direct(choices: Choices) -> Choices:
    """The same of the formula, without what only a fit has reasons for."""
    if not choices.model_based:
        return choices
    kept = tuple(pair for pair in choices.reasons if pair[0] not in OF_CONSTRAINTS)
    return replace(choices, model_based=False, reasons=kept)


def as_fit(choices: Choices, best: Choices) -> Choices:
    """Those of a fit: as they were given, or as such scans are fitted best.

    Args:
        choices: of a direct image.
        best: of the same scan, with the more accurate method.
    """
    if not best.model_based:
        fit = replace(choices, model_based=True, penalty="tv", nonnegative=True)
        names = "model_based", "penalty", "nonnegative"
        return with_reasons(fit, dict.fromkeys(names, "chosen in the viewer"))
    fit = replace(choices, **{name: getattr(best, name) for name in OF_CONSTRAINTS})
    for name, reason in best.reasons:
        if name in OF_CONSTRAINTS:
            fit = fit.with_reason(name, reason, best.grade(name))
    return fit


def with_reasons(choices: Choices, reasons: Mapping[str, str]) -> Choices:
    """Choices with these reasons, graded sure: those that the controls decide."""
    for name, reason in reasons.items():
        choices = choices.with_reason(name, reason, SURE)
    return choices
