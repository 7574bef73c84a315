"""Images for several values of one choice, to compare by eye."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ..base.choice_table import NUMBERS, OF_REGION, OF_TWO_SPEEDS
from ..io import Scan
from .acquisition import in_space, some_frames
from .choices import Choices
from .choosing import choose
from .frames import setup_of
from .images import ScanImages, reconstruct
from .medium import OF_BODY
from .method import OF_FORMULA

_OF_IMAGE = *OF_REGION, "max_frequency"
_OF_RECORD = ("model", "sound_speed", *OF_BODY, "time_shift", "dead_time", "band")
_FOLLOW = {"region_radius": ("region_cut", "half_width", "pixels", *OF_FORMULA)}
"""What follows from a choice, and is chosen anew with it."""


def trials(
    scan: Scan, choices: Choices, given: Mapping[str, Any], name: str, values: Sequence[float]
) -> Iterator[ScanImages]:
    """Images of the first frame with one choice at each of the values.

    All other choices are those given, so that the images differ by one alone; of a region's
    radius the pixels and the cut follow it. All values are looked at before the first image is
    made.

    Args:
        scan: in the plane.
        choices: from `choose`, of the scan.
        given: options with which they were chosen.
        name: of the choice, a number.
        values: to try, in the units of the scan.

    Yields:
        ScanImages, one for each value.

    Raises:
        ValueError: at once, for a choice that is no number or that the data do not have, detectors
            around a volume, and values that cannot be; later as `reconstruct`.
    """
    if name not in NUMBERS:
        raise ValueError(f"{name} cannot be tried, expected one of {', '.join(NUMBERS)}.")
    if in_space(scan):
        raise ValueError(
            "the detectors surround a volume, and trials are pictures in the plane: reconstruct "
            f"once for each {name} instead."
        )
    if scan.kind != "pressure" and name in _OF_RECORD:
        raise ValueError(f"{name} is of pressure records, and the data are circular integrals.")
    scan = some_frames(scan, [0])
    asked = {key: value for key, value in given.items() if key not in OF_TWO_SPEEDS}
    others = asked | _kept(scan, choices, name)
    chosen = [_trial(scan, others, name, value) for value in values]
    return (reconstruct(scan, trial) for trial in chosen)


def _kept(scan: Scan, choices: Choices, name: str) -> dict[str, Any]:
    """The choices that stay as they are when one of them is tried."""
    fixed = (*_OF_IMAGE, *(_OF_RECORD if scan.kind == "pressure" else ()))
    fixed += () if choices.model_based else OF_FORMULA
    of_disk = ("region_radius", "region_cut") if choices.region_size else ()
    follow = (*_FOLLOW.get(name, ()), *of_disk)
    kept = {key: getattr(choices, key) for key in fixed if key not in follow}
    if "band" in kept and kept["band"] is None:
        kept["band"] = "none"
    return kept


def _trial(scan: Scan, others: dict[str, Any], name: str, value: float) -> Choices:
    """Choices with one value, of which a setup can be made, or ValueError that names it."""
    try:
        trial = choose(scan, **others | {name: value})
        setup_of(scan, trial)
    except ValueError as error:
        raise ValueError(f"{name} {value:.6g} cannot be tried: {error}") from error
    return trial
