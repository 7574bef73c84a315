"""Files of an image: a picture, a file for ``--repeat``, and a command that makes it."""

import shlex
from collections.abc import Mapping
from dataclasses import replace
from itertools import count, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..base.choice_table import CONSTRAINTS, OPTIONS, RECORD, words_of
from ..base.units import ROUNDING
from ..io.images import save_image
from ..scans import Choices
from ..scans.method import OF_FORMULA
from ..scans.pipeline import NOT_IN_SPACE
from .image_methods import BACK_PROJECTION
from .session import ControlValues, Session
from .volume_session import ShownVolume, VolumeSession


def keep(
    session: Session, controls: ControlValues, folder: Path, suffix: str, source: Path | None
) -> Path:
    """Write the image to a new file in a folder.

    Args:
        session, controls: which image.
        folder: of the file, whose name is that of the scan, the frame's number, and one more.
        suffix: ".png" for a picture; ".h5" keeps all choices, for ``--repeat``.
        source: the scan's file, whose SHA-256 is kept too.

    Returns:
        The file's path.

    Raises:
        ValueError: for choices of back-projection, and where no file can be made.
    """
    if suffix == ".png" and controls.method == BACK_PROJECTION:
        settings: dict[str, Any] = {"method": BACK_PROJECTION}
    else:
        settings = session.choices_of(controls).settings() | session.frame_facts(controls.frame)
    controls = replace(controls, disk=None)  # what is said of the image is true of all the region
    image, frames = np.where(session.inside, session.image(controls), 0.0), None
    if session.scan.data.ndim == 3:
        wavelengths = session.scan.known.get("wavelengths")
        number = session.frame_number(controls.frame)
        image, frames = (
            image[None],
            [number if wavelengths is None else wavelengths[controls.frame]],
        )
    path = _free(folder, source, controls.frame, suffix)
    region, grid = session.choices.region, session.choices.grid
    inputs = [source] if source else []
    unit = session.choices.units.length
    save_image(path, image, grid, region, settings, frames=frames, unit=unit, inputs=inputs)
    return path


def keep_volume(
    session: VolumeSession, shown: ShownVolume, folder: Path, suffix: str, source: Path | None
) -> Path:
    """Write a volume to a new file in a folder, as `jaxtat reconstruct` does.

    Args:
        session, shown: the volume, and whose it is.
        folder, source: as in `keep`.
        suffix: ".nii.gz" for other programs; ".h5" keeps all choices, for ``--repeat``.

    Raises:
        ValueError: where no file can be made.
    """
    made, path = shown.made, _free(folder, source, shown.frame, suffix)
    settings = made.choices.settings() | session.frame_facts(shown.frame)
    inputs = [source] if source else []
    about = {"frames": made.frames, "unit": made.unit, "inputs": inputs}
    save_image(path, made.image, made.grid, made.region, settings, **about)
    return path


def _free(folder: Path, source: Path | None, frame: int, suffix: str) -> Path:
    """The first of the numbered names that no file has yet."""
    name = f"{source.stem if source else 'scan'}-{frame}"
    paths = (folder / f"{name}-{number}{suffix}" for number in count(1))
    return next(path for path in paths if not path.exists())


def command_line(choices: Choices, facts: Mapping[str, Any], file: str = "FILE") -> str:
    """The command that makes an image with options alone.

    It chooses the radii of the integrals again; with ``--repeat`` they are the same too.

    Args:
        choices: of the image.
        facts: what else was said of the scan, by the names of options.
        file: the scan's.
    """
    words = ["jaxtat", "reconstruct", file]
    for name, value in facts.items():
        words += words_of(name, value)
    if choices.left_out and not facts.get("use"):
        words += words_of("use", _slices(choices.channels))
    for choice in OPTIONS:
        if _is_said(choice.name, choice.group, choices):
            words += words_of(choice.name, _value(choice.name, choices))
    return shlex.join([*words, "--out", "volume.nii.gz" if choices.in_space else "image.png"])


def _value(name: str, choices: Choices) -> Any:
    """The value as a word of the command line."""
    value = getattr(choices, name)
    if name in ("region_center", "body_center") and value is not None:
        # what rounding left of zero is zero
        least = ROUNDING * choices.region_radius
        return tuple(x if abs(x) > least else 0.0 for x in value)
    return "none" if name == "band" and value is None else value


def _is_said(name: str, group: str | None, choices: Choices) -> bool:
    if choices.in_space and name in NOT_IN_SPACE:
        return False
    if group == RECORD:
        return choices.model != "none"
    if group == CONSTRAINTS or name in OF_FORMULA:
        return choices.model_based == (group == CONSTRAINTS)
    whole = choices.region_cut >= choices.region_radius
    if choices.region_size and name == "region_radius":
        return False
    return not (whole and name in ("region_cut", "region_angle"))


def _slices(rows: tuple[int, ...]) -> str:
    """Rows in the words of ``--use``.

    >>> _slices((6, 7, 0, 1, 3))
    '0:2,3:4,6:8'
    """
    kept = sorted(rows)
    ends = [k for k, (one, other) in enumerate(pairwise(kept)) if other != one + 1]
    starts, stops = [0, *(k + 1 for k in ends)], [*ends, len(kept) - 1]
    return ",".join(f"{kept[a]}:{kept[b] + 1}" for a, b in zip(starts, stops, strict=True))
