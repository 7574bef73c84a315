"""The image under constraints, on a page beside the direct one."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers
from ..fitting import Comparison


class Constrained(NamedTuple):
    """An image under constraints, and what the data say of it.

    Attributes:
        image: (x1, x2).
        how: penalty and constraint, in words.
        comparison: with the direct image, which comes first.
        converged: whether it was found to the tolerance.
    """

    image: Float[Array, "x1 x2"]
    how: str
    comparison: Comparison
    converged: bool


def in_words(constrained: Constrained) -> str:
    """The text about what the penalty and what the data decided."""
    both = constrained.comparison
    direct, fitted = (float(misfit) for misfit in both.misfits)
    differ, told = float(both.differ), float(both.told)
    text = (
        f"The direct image leaves {direct:.0%} of the data unexplained, the image under "
        f"constraints {fitted:.0%}. They differ by {differ:.0%} of the image; {told:.0%} of the "
        "data tells them apart. "
    )
    if told < min(direct, fitted):
        text += (
            "That is less than either leaves unexplained: the data hardly speak of the difference, "
            "so it is the penalty's. What is in one image only should not be relied on."
        )
    elif fitted <= direct:
        text += (
            "The data speak for the image under constraints: what the formula left out or made "
            "wrong, such as low frequencies that the band took away, has been filled in. Thin and "
            "faint things that are only in the direct image may still have been removed by the "
            "penalty."
        )
    else:
        text += "The data speak for the direct image: the constraints are too strong, or not true."
    return (
        text
        if constrained.converged
        else f"{text} The iterations did not converge: the level of wide parts is uncertain."
    )


def limits_of(*images: Numbers) -> tuple[float, float]:
    """Common grey levels of all images."""
    values = np.concatenate([np.ravel(np.asarray(image)) for image in images])
    low, high = np.nanpercentile(values, [0.2, 99.8])
    return float(low), float(high)
