"""The fitted image, on a page beside the direct one."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float

from ..fitting import NINETY, Comparison
from ..scans.errors_of_images import ImageErrors


class Constrained(NamedTuple):
    """A fitted image, and how well the data support it.

    Attributes:
        image: (x1, x2).
        how: penalty and constraint, in words.
        comparison: with the direct image, which comes first.
        unsettled: in words, what more steps would change; nothing if it converged.
        band: pass band of the record in words, if it begins above zero.
        errors: how far the image may be off; None if that was not computed.
    """

    image: Float[Array, "x1 x2"]
    how: str
    comparison: Comparison
    unsettled: str = ""
    band: str = ""
    errors: ImageErrors | None = None


def in_words(constrained: Constrained) -> str:
    """Text on what the data and what the penalty determined."""
    both = constrained.comparison
    direct, fitted = (float(misfit) for misfit in both.misfits)
    differ, told = float(both.differ), float(both.told)
    text = (
        f"The direct image leaves {direct:.0%} of the data unexplained, the fitted image "
        f"{fitted:.0%}. They differ by {differ:.0%} of the image, and their data by {told:.0%}. "
    )
    if told < min(direct, fitted):
        text += (
            "That is less than either leaves unexplained: the data do not decide between them, and "
            "the difference is due to the penalty. Do not rely on what is in one image only."
        )
    elif fitted <= direct:
        text += (
            "The data favour the fitted image: it restores what the direct formula misses, such as "
            "low frequencies outside the record's band. Thin and faint details that are only in "
            "the direct image may still be real: the penalty can remove them."
        )
    else:
        text += "The data favour the direct image: the constraints are too strong, or wrong."
    left = constrained.unsettled
    return f"{text} The iterations did not converge: {left}." if left else text


def not_in_the_data(constrained: Constrained) -> str:
    """Text on what a record without low frequencies does not hold; nothing for others."""
    if not constrained.band:
        return ""
    return (
        f"The level inside the body is not in the record (band from {constrained.band}); edges "
        f"are. The level follows from penalty and constraint ({constrained.how})."
    )


def errors_in_words(errors: ImageErrors) -> str:
    """Text on the size of the errors."""
    image, deviation = np.asarray(errors.image), np.asarray(errors.deviation)
    most = float(np.nanmax(np.abs(image)))
    middle, high = (float(np.nanpercentile(deviation, share)) for share in (50, 95))
    of_most = f" ({middle / most:.1%} of its largest value)" if most > 0 else ""
    return (
        f"Means of the fitted image over these pixels are off by {middle:.2g} in the median"
        f"{of_most}, and by {high:.2g} where errors are largest. Nine of ten errors are taken to "
        f"be below {NINETY} times that."
    )
