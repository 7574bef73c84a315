"""The automatic choices for a scan; each can be given instead."""

import logging
from collections.abc import Mapping
from typing import Any

from ..base.checks import is_concrete, real_array
from ..base.choice_table import BODY_SHAPES, OF_TWO_SPEEDS, OPTIONS, SURE, require_pixels
from ..io import Scan
from ..io.scan import require_one_rate
from .acquisition import in_space
from .choices import Choices
from .noise import estimate_alpha
from .two_speeds import (
    choices_of,
    lacks_second,
    may_have_two,
    require_one,
    with_clear_body,
    with_one_said,
    with_two_speeds,
    with_water_of,
)

_LOG = logging.getLogger(__name__)


def choose(scan: Scan, **given: Any) -> Choices:
    """All choices for a scan, by its file and by what images leave of it, see `misfit`.

    Args:
        scan: from `load_scan`.
        given: choices by name, as in `Choices`; further ``use``, rows of the data to use
            (noisy and saturated ones among them too), ``radii`` of the circular integrals,
            ``band="none"``, ``length_unit``, in which the scan's positions are: "m", "cm", "mm" or
            "um", ``two_speeds``: True to estimate a body of another speed of sound than that of
            water, see `estimate_body`, as where ``water_speed`` is given alone and where images
            of one speed leave the start of a record in the plane open, False for one speed;
            ``body_shape``: "ellipse" to estimate that where it explains clearly more than a disk;
            and ``water_temperature`` [°C] in place of ``water_speed``. What is None is chosen.

    Returns:
        Choices, with a reason for each.

    Raises:
        ValueError: for unknown names, what a scan lacks, and data that cannot be.
    """
    _require_known(given)
    require_one_rate(scan)
    made = estimate_alpha(scan, _chosen(scan, given))
    if given.get("length_unit") is None:
        return made
    return made.with_reason("length_unit", "given", SURE)


NAMES = (
    "use",
    "radii",
    "length_unit",
    "impulse_response",
    "laser_energy",
    *OF_TWO_SPEEDS,
    *(choice.name for choice in OPTIONS),
)


def _chosen(scan: Scan, given: Mapping[str, Any]) -> Choices:
    others = dict(given)
    two, shape = others.pop("two_speeds", None), others.pop("body_shape", None) or "disk"
    if shape not in BODY_SHAPES:
        raise ValueError(f"body_shape is {shape!r}, expected one of {', '.join(BODY_SHAPES)}.")
    only_one = two is not None and not two
    if only_one:
        require_one(scan, others, shape)
    for name in ("body_center",) if in_space(scan) else ("region_center", "body_center"):
        if given.get(name) is not None:
            real_array(name, given[name], (3 if in_space(scan) else 2,))
    if given.get("body_axes") is not None:
        real_array("body_axes", given["body_axes"], (2,))
    others = with_water_of(scan, others)
    if two or shape != "disk" or lacks_second(scan, others):
        return with_two_speeds(scan, others, shape)
    made = choices_of(scan, others)
    if only_one:
        return with_one_said(made)
    if not may_have_two(scan, others, made):
        return made
    _LOG.info(
        "one speed of sound leaves the start of the record open: a body of another speed is looked "
        "for, which takes a minute or two (--one-speed leaves it out)"
    )
    return with_clear_body(scan, others, made)


def _require_known(given: Mapping[str, Any]) -> None:
    unknown = [name for name in given if name not in NAMES]
    if unknown:
        raise ValueError(f"unknown options {unknown}, expected some of {', '.join(NAMES)}.")
    traced = [name for name, value in given.items() if not is_concrete(value)]
    if traced:
        raise ValueError(
            f"{traced[0]} is traced, and choices of a scan are made of known numbers: for "
            "derivatives take a Setup with pressure_to_circular_integrals and reconstruct, or "
            "model_based."
        )
    for choice in OPTIONS:
        if choice.bound and given.get(choice.name) is not None:
            choice.require(float(real_array(choice.name, given[choice.name], ())))
    require_pixels(given.get("pixels"))
