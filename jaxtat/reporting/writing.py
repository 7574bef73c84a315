"""From a reconstruction to a page."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..base.atomic import replacing, require_place
from ..base.checks import Numbers
from ..base.units import millimetres
from ..io.provenance import provenance_of
from ..reconstruction import ReconstructionPlan, Setup
from ..steps.radon import LowPass
from ..studies import Diagnosis, diagnose
from .constrained import Constrained


def report(
    setup: Setup,
    g: Numbers,
    image: Numbers,
    path: str | Path,
    *,
    plan: ReconstructionPlan | None = None,
    sigma: Numbers | None = None,
    noise: Numbers | None = None,
    low_pass: LowPass | None = None,
    inversion: str = "fourier",
    uncertainty_pixels: int | None = None,
    constrained: Constrained | None = None,
    title: str = "Reconstruction",
    choices: Sequence[tuple[str, str, str, str]] = (),
    channels: Sequence[int] | None = None,
    inputs: Sequence[str | Path] = (),
    unit: str | None = None,
    progress: bool = False,
) -> Diagnosis:
    """Write a page about one image: one HTML file with all figures in it, no scripts, no links.

    Args:
        setup, g, image: the problem, in the plane, the data of one image, and the image.
        path: the file to write.
        plan, sigma, noise, low_pass, inversion, uncertainty_pixels, progress: as in `diagnose`.
        constrained: the fitted image, to be shown beside it.
        title: of the page.
        choices: what was chosen for the reconstruction, rows of (name, value, grade, why).
        channels: number of every detector in the file, if it is not its number along the curve.
        inputs: files that the data come from; their names and SHA-256 go into the page.
        unit: of length: "m", "cm", "mm" or "um", then the page is in millimetres; None if it is
            not known.

    Returns:
        Diagnosis, the numbers behind the page.

    Raises:
        ValueError: as `diagnose`, and for a path where no file can be written, which is found out
            before anything is computed.
        FileNotFoundError: if there is no such input.
    """
    require_place(path)
    millimetres(unit)
    origin = provenance_of(inputs, unit)
    diagnosis = diagnose(
        setup,
        g,
        image,
        plan=plan,
        sigma=sigma,
        noise=noise,
        low_pass=low_pass,
        inversion=inversion,
        uncertainty_pixels=uncertainty_pixels,
        progress=progress,
    )
    write_report(
        path,
        diagnosis,
        constrained=constrained,
        title=title,
        choices=choices,
        channels=channels,
        origin=origin,
        unit=unit,
    )
    return diagnosis


def write_report(
    path: str | Path,
    diagnosis: Diagnosis,
    *,
    constrained: Constrained | None = None,
    title: str = "Reconstruction",
    choices: Sequence[tuple[str, str, str, str]] = (),
    channels: Sequence[int] | None = None,
    origin: dict[str, Any] | None = None,
    unit: str | None = None,
) -> None:
    """Write the page on a diagnosis; after an error the file is as it was before.

    Args:
        path: the file to write.
        diagnosis: from `diagnose`.
        constrained, title, choices, channels, unit: as in `report`.
        origin: of `jaxtat.io.provenance.provenance_of`; by default without input files.
    """
    from .page import Page, html_page  # matplotlib is slow to import

    origin = provenance_of((), unit) if origin is None else origin
    rows = [*_of_problem(diagnosis), *_origin(origin)]
    text = html_page(diagnosis, Page(title, choices, rows, unit, channels, constrained))
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _of_problem(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    detectors, radii = diagnosis.g.shape
    rows = [
        ("data", f"{detectors} detectors x {radii} radii"),
        ("image", f"{diagnosis.setup.grid.shape[0]} x {diagnosis.setup.grid.shape[1]} pixels"),
    ]
    if diagnosis.waves is not None:
        frequencies, directions = diagnosis.waves.residual.shape
        rows.append(("plane waves", f"{frequencies} frequencies x {directions} directions"))
    return rows


def _origin(origin: dict[str, Any]) -> list[tuple[str, str]]:
    """Table rows of `provenance_of`."""
    inputs = [(f"file {i['name']}", f"SHA-256 {i['sha256']}") for i in origin["inputs"]]
    versions = ", ".join(f"{name} {number}" for name, number in origin["versions"].items())
    made = [("made", origin["date"]), ("computed on", origin["platform"])]
    return [*inputs, ("software", versions), *made]
