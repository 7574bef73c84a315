"""The automatic choices for a scan; each can be given instead."""

from collections.abc import Mapping
from typing import Any

from ..base.checks import real_array
from ..base.choice_table import OPTIONS, SURE, require_pixels
from ..io import Scan
from ..io.scan import require_one_rate
from .acquisition import in_space
from .choices import Choices
from .choose_in_plane import choices_in_plane
from .choose_in_space import choices_in_space
from .noise import estimate_alpha


def choose(scan: Scan, **given: Any) -> Choices:
    """All choices for a scan, by its file and by what images leave of it, see `misfit`.

    Args:
        scan: from `load_scan`.
        given: choices by name, as in `Choices`; further ``use``, rows of the data to use (bad
            channels among them too), ``radii`` of the circular integrals, ``band="none"``, and
            ``length_unit``, in which the scan's positions are: "m", "cm", "mm" or "um".
            What is None is chosen.

    Returns:
        Choices, with a reason for each.

    Raises:
        ValueError: for unknown names, what a scan lacks, and data that cannot be.
    """
    _require_known(given)
    require_one_rate(scan)
    made = choices_in_space(scan, given) if in_space(scan) else choices_in_plane(scan, given)
    made = estimate_alpha(scan, made)
    if given.get("length_unit") is None:
        return made
    return made.with_reason("length_unit", "given", SURE)


NAMES = (
    "use",
    "radii",
    "length_unit",
    "impulse_response",
    "laser_energy",
    *(choice.name for choice in OPTIONS),
)


def _require_known(given: Mapping[str, Any]) -> None:
    unknown = [name for name in given if name not in NAMES]
    if unknown:
        raise ValueError(f"unknown options {unknown}, expected some of {', '.join(NAMES)}.")
    for choice in OPTIONS:
        if choice.bound and given.get(choice.name) is not None:
            choice.require(float(real_array(choice.name, given[choice.name], ())))
    if given.get("region_center") is not None:
        real_array("region_center", given["region_center"], None)
    require_pixels(given.get("pixels"))
