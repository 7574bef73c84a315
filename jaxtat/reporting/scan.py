"""From a scan, and what was chosen for it, to a page."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..checks import Numbers, whole_number
from ..diagnostics import UNCERTAINTY_PIXELS, Diagnosis
from ..io import Scan, load_scan
from ..measured import Choices, Where, choices_for, estimate_sound_speed, integrals, with_facts
from ..measured.choices import LOW_PASSES
from ..measured.facts import facts_of
from ..plan import ReconstructionPlan, build_plan
from ..reconstruction import reconstruct
from ..regularization import Tikhonov
from .report import report


def report_file(
    path: str | Path,
    out: str | Path,
    *,
    scanner: str | None = None,
    detectors: Any = None,
    sampling_rate: float | None = None,
    times: Any = None,
    progress: bool = True,
    **given: Any,
) -> Diagnosis:
    """A page about the first image of a scan file, everything chosen that is not given.

    Args:
        path: a file that `load_scan` reads.
        out: the page to write.
        scanner, detectors, sampling_rate, times: what the file does not tell, see `with_facts`.
        progress: show progress bars.
        given: choices by name, see `choices_for`.

    Returns:
        Diagnosis, the numbers behind the page.

    Raises:
        FileNotFoundError, ValueError: as `reconstruct_file` and `report`.
    """
    facts = {"detectors": detectors, "sampling_rate": sampling_rate, "times": times}
    scan = with_facts(load_scan(path), scanner=scanner, **facts)
    choices = estimate_sound_speed(scan, choices_for(scan, **given))
    return report_scan(out, scan, choices, title=Path(path).name, inputs=[path], progress=progress)


def report_scan(
    path: str | Path,
    scan: Scan,
    choices: Choices,
    *,
    plan: ReconstructionPlan | None = None,
    frame: int = 0,
    sigma: Numbers | None = None,
    uncertainty_pixels: int = UNCERTAINTY_PIXELS,
    title: str = "Reconstruction",
    inputs: Sequence[str | Path] = (),
    unit: str | None = None,
    progress: bool = True,
) -> Diagnosis:
    """A page about one image of a scan.

    The image is made with a plan, which tells accuracy and noise of every plane wave; without one
    given it is that of the Tikhonov regularisation that `reconstruct_direct` uses, so that the
    image is the same.

    Args:
        path: the page to write.
        scan: from `load_scan`.
        choices: from `choices_for`.
        plan: that has decided geometry and regularisation.
        frame: number of the image, from 0.
        sigma, uncertainty_pixels, title, inputs, progress: as in `report`.
        unit: of length, by default what the sizes in the scan say.

    Returns:
        Diagnosis.

    Raises:
        ValueError: for a frame that is not there, and as `build_plan` and `report`.
    """
    frame = whole_number("frame", frame, 0)
    if frame >= scan.n_frames:
        raise ValueError(f"frame is {frame}, but the scan has {scan.n_frames}, counted from 0.")
    where = Where.of(scan, choices) if plan is None else Where.of_plan(plan)
    g = integrals(scan, choices, where.radii, scan.frame(frame))
    problem = where.curve, where.region, where.grid, where.radii
    if plan is None:
        rule, most = Tikhonov(choices.alpha), choices.max_frequency
        plan = build_plan(*problem, rule, max_frequency=most, progress=progress)
    last = {"low_pass": LOW_PASSES[choices.low_pass], "inversion": choices.inversion}
    several = f", frame {frame} of {scan.n_frames}" if scan.n_frames > 1 else ""
    return report(
        path,
        *problem,
        g,
        reconstruct(plan, g, **last),
        plan=plan,
        sigma=sigma,
        uncertainty_pixels=uncertainty_pixels,
        title=title + several,
        choices=choices.rows(),
        channels=choices.channels,
        inputs=inputs,
        unit=unit or facts_of(scan).units.length,
        progress=progress,
        **last,
    )
