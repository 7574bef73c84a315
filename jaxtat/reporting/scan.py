"""The report on a scan and its choices."""

import warnings
from collections.abc import Sequence
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, whole_number
from ..io import Scan
from ..reconstruction import ReconstructionPlan, Setup, build_plan, reconstruct
from ..regularization import Tikhonov
from ..scans import (
    Choices,
    integrals,
    setup_of,
)
from ..scans.acquisition import facts_of
from ..scans.constrained import compared, fitted, warn_of_hardly_any
from ..scans.deviations import draw, quiet_noise
from ..scans.errors_of_images import fit_errors
from ..scans.frames import lit_frames
from ..steps import UnreachedWaves
from ..studies import Diagnosis
from .constrained import Constrained
from .writing import report


def report_scan(
    path: str | Path,
    scan: Scan,
    choices: Choices,
    *,
    plan: ReconstructionPlan | None = None,
    frame: int = 0,
    sigma: Numbers | None = None,
    uncertainty_pixels: int | None = None,
    title: str = "Reconstruction",
    inputs: Sequence[str | Path] = (),
    unit: str | None = None,
    progress: bool = False,
) -> Diagnosis:
    """A page about one image of a scan.

    The image is made with a plan, which has accuracy and noise of every plane wave; without one
    given it is that of the Tikhonov regularisation that `solve` uses, so that the
    image is the same.

    Args:
        path: the page to write.
        scan: from `load_scan`.
        choices: from `choose`.
        plan: that has decided geometry and regularisation.
        frame: number of the image, from 0.
        sigma, uncertainty_pixels, title, inputs, progress: as in `report`; 0 pixels also leave
            out how far a fitted image may be off.
        unit: of length, by default what the sizes in the scan say.

    Returns:
        Diagnosis.

    Raises:
        ValueError: for a frame that is not there, and as `build_plan` and `report`.
    """
    frame = whole_number("frame", frame, 0)
    if frame >= scan.n_frames:
        raise ValueError(f"frame is {frame}, but the scan has {scan.n_frames}, counted from 0.")
    facts = facts_of(scan)  # refuses detectors around a volume
    setup = setup_of(scan, choices) if plan is None else plan.setup
    (recorded,) = lit_frames(scan, choices, frame, frame + 1)
    g = integrals(scan, choices, setup, recorded)
    noise = _noise_alone(scan, choices, setup, recorded) if sigma is None else None
    if plan is None:
        with warnings.catch_warnings():  # of waves below the noise, which the page grades
            warnings.simplefilter("ignore", UnreachedWaves)
            plan = build_plan(setup, Tikhonov(choices.alpha), progress=progress)
    else:
        choices = choices.regularised_by_plan()
    low_pass, inversion = choices.low_pass, choices.inversion
    image = reconstruct(plan, g, low_pass=low_pass, inversion=inversion)
    constrained = None
    if choices.model_based:
        constrained = _constrained(scan, choices, setup, recorded, image, progress)
        if uncertainty_pixels != 0:
            errors = fit_errors(scan, choices, recorded, constrained.image)
            constrained = constrained._replace(errors=errors)
    several = f", frame {frame} of {scan.n_frames}" if scan.n_frames > 1 else ""
    return report(
        setup,
        g,
        image,
        path,
        plan=plan,
        constrained=constrained,
        sigma=sigma,
        noise=noise,
        uncertainty_pixels=uncertainty_pixels,
        title=title + several,
        choices=choices.rows(),
        channels=choices.channels,
        inputs=inputs,
        unit=unit or facts.units.length,
        progress=progress,
        low_pass=low_pass,
        inversion=inversion,
    )


def _constrained(
    scan: Scan,
    choices: Choices,
    setup: Setup,
    frame: np.ndarray,
    direct: Array,
    progress: bool,
) -> Constrained:
    """The frame's fitted image, beside the direct one."""
    fit = fitted(scan, choices, setup, frame, progress=progress)
    warn_of_hardly_any(np.atleast_1d(fit.residual), np.zeros(1, int))
    both = compared(scan, choices, setup, frame, direct, fit.image)
    how = f"{choices.penalty}, f >= 0" if choices.nonnegative else choices.penalty
    band = ""
    if choices.band is not None and choices.band[0] > 0:
        band = choices.units.of_band(*choices.band)
    left = "" if bool(fit.converged) else fit.unsettled()
    return Constrained(fit.image, how, both, left, band)


def _noise_alone(
    scan: Scan, choices: Choices, setup: Setup, frame: np.ndarray
) -> Float[Array, "detectors radii"] | None:
    """Circular integrals of noise as in the quiet part of a record; None without a quiet part."""
    noise = quiet_noise(scan, choices, setup, frame)
    if noise is None:
        return None
    return integrals(scan, choices, setup, draw(scan, choices, noise, jax.random.key(0)))
