"""From command-line options to a scan, fixed choices and plans."""

import argparse
import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from ..base.choice_table import BESIDES, OF_TWO_SPEEDS, OPTIONS, option_of
from ..base.messages import name_of
from ..base.units import MICROSECONDS, seconds
from ..geometry import Disk, Region, circular_arc, in_plane
from ..io import Scan, load_response, load_scan, load_settings
from ..io.frames import LazyFrames
from ..reconstruction import ReconstructionPlan, Setup, build_plan
from ..regularization import FixedRank, NormBound, Regularization, SingularValueCutoff
from ..scans import Choices, choose, setup_of, with_facts
from ..scans.acquisition import facts_of, in_space
from ..scans.frames import require_radii
from ..scans.medium import OF_BODY
from ..scans.space import units_of_scan
from ..steps import AccuracyWarning, polar_grid
from .option_checks import band, is_given, require_values, slices

SAME = 1e-6  # of the size: positions and radii that differ by less are the same
OF_RESPONSE = ("impulse_response_file", "element_band")
FACTS = ("arc", "ring", "scanner", "sampling_rate", "duration", "start_time", "use", "frames")
FACTS += OF_RESPONSE
_OPTIONS = (
    "file",
    "out",
    "format",
    "quiet",
    "force",
    "cache",
    "no_cache",
    "repeat",
    "length_unit",
    "plan",
    "json",
    "trial",
    "jobs",
    "of_folder",
    "of_fit",
    "errors",
    *OF_TWO_SPEEDS,
)


def scan_of(
    options: argparse.Namespace, plan: ReconstructionPlan | None = None
) -> tuple[Scan, argparse.Namespace]:
    """The file's scan with positions and times from the options; and the remaining options."""
    scan, positions = load_scan(options.file), _positions(options)
    unknown = positions is None and options.scanner is None and "detectors" not in scan.known
    if "detectors" in scan.known and (positions is not None or options.scanner is not None):
        option = "--arc" if options.arc else "--ring" if options.ring else "--scanner"
        said = f"{option} replaces the positions of the detectors in the file."
        warnings.warn(said, AccuracyWarning, stacklevel=2)
    if unknown and plan is not None:
        scan, positions = _rows(scan, options.use), np.asarray(plan.curve.points)
        options = changed(options, use=None)  # done
    rate, duration = getattr(options, "sampling_rate", None), getattr(options, "duration", None)
    frames = getattr(options, "frames", None)
    if frames is not None:
        frames = chosen(frames, scan.n_frames, "--frames", "frames")
    if duration is not None:  # it replaces what the file says
        clock = ("times", "sampling_rate")
        scan = replace(scan, known={k: v for k, v in scan.known.items() if k not in clock})
    facts = {"detectors": positions, "sampling_rate": rate, "frames": frames}
    scan = with_facts(scan, scanner=options.scanner, **facts)
    if isinstance(duration, str):
        duration = seconds(duration)
    rate = None if duration is None else (scan.n_samples - 1) / duration
    response = getattr(options, "impulse_response_file", None)
    scan = with_facts(scan, sampling_rate=rate)
    scan = with_facts(
        scan,
        start_time=_time_of(options, "start_time", scan),
        element_response=None if response is None else load_response(response),
        element_band=getattr(options, "element_band", None),
    )
    return scan, options


def changed(options: argparse.Namespace, **new: Any) -> argparse.Namespace:
    """A copy of the options with some of them replaced."""
    return argparse.Namespace(**vars(options) | new)


def given(
    options: argparse.Namespace, scan: Scan, plan: ReconstructionPlan | None = None
) -> dict[str, Any]:
    """Choices that are fixed by the options or by a plan."""
    made = {choice.name: getattr(options, choice.name, None) for choice in OPTIONS}
    for name in ("length_unit", *OF_TWO_SPEEDS):
        made[name] = getattr(options, name, None)
    for name in ("time_shift", "dead_time"):
        made[name] = _time_of(options, name, scan)
    made["use"] = None if options.use is None else chosen(options.use, scan.n_detectors)
    if made["band"] is not None:
        made["band"] = band(made["band"])
    if plan is None:
        return made
    grid = plan.grid
    return made | {
        "use": _rows_of(plan, scan) if made["use"] is None else made["use"],
        **_region_of(plan.region),
        "pixels": grid.shape[0],
        "half_width": float(grid.half_width[0]),
        "max_frequency": float(plan.frequencies[-1]),
        "radii": np.asarray(plan.radii),
    }


def _time_of(options: argparse.Namespace, name: str, scan: Scan) -> float | None:
    """A time among the options, in the unit of the scan's times."""
    time = getattr(options, name, None)
    if not isinstance(time, str) or scan.kind != "pressure":  # of which integrals have none
        return seconds(time) if isinstance(time, str) else time
    unit = units_of_scan(scan).time
    if unit is None:
        raise ValueError(
            f"{option_of(name)} {time}: the unit of the record's times is not known: give a number "
            "in that unit."
        )
    return seconds(time) * (1e6 / MICROSECONDS[unit])


def _region_of(region: Region) -> dict[str, Any]:
    """A plan's region as choices: a disk, or the rectangle about what is no disk."""
    if isinstance(region, Disk):
        return {
            "region_radius": float(region.radius),
            "region_cut": float(region.cut),
            "region_angle": float(np.degrees(region.angle)),
            "region_center": tuple(float(x) for x in region.center),
        }
    corners = np.asarray(getattr(region, "vertices", region.points))
    low, high = corners.min(axis=0), corners.max(axis=0)
    center = (low + high) / 2
    return {
        "region_size": tuple(float(x) for x in high - low),
        "region_center": tuple(float(x) for x in center),
    }


def repeated(options: argparse.Namespace) -> tuple[Choices, argparse.Namespace]:
    """The choices of an earlier image, with its positions and times unless options replace them."""
    settings = load_settings(options.repeat)
    facts = {
        fact.name: fact.stored(settings[fact.name])
        for fact in BESIDES
        if settings.get(fact.name) is not None
        and hasattr(options, fact.name)
        and not is_given(options, fact.name)
    }
    facts = _without_stored_response(options, facts, name_of(options.repeat))
    plan, name = settings.get("plan"), name_of(options.repeat)
    if plan is None and getattr(options, "plan", None) is not None:
        raise ValueError(f"--plan and --repeat: {name} was made without a plan.")
    if plan is not None and getattr(options, "plan", None) is None:  # a file may name any other
        raise ValueError(
            f"{name} was made with the plan {plan!r:.60}, which is opened only if you name it: "
            "--plan."
        )
    others = {*_OPTIONS, *(fact.name for fact in BESIDES)}
    of_choices = {name: value for name, value in settings.items() if name not in others}
    options = changed(options, **facts)
    require_values(options)
    choices = Choices.from_settings(of_choices)
    if any(getattr(options, name, None) is not None for name in OF_RESPONSE):
        choices = replace(choices, impulse_response=True)
    return choices, options


def _without_stored_response(
    options: argparse.Namespace, facts: dict[str, Any], name: str
) -> dict[str, Any]:
    """Facts of an earlier image without its response, if an option gives one.

    Raises:
        ValueError: for a file of a response that no option names: a file may name any other.
    """
    if any(is_given(options, each) for each in OF_RESPONSE if hasattr(options, each)):
        return {key: value for key, value in facts.items() if key not in OF_RESPONSE}
    if "impulse_response_file" in facts:
        stored = facts["impulse_response_file"]
        raise ValueError(
            f"{name} was made with the response in {stored!r:.60}, which is opened only if you "
            "name it: --impulse-response."
        )
    return facts


def setup_of_plan(options: argparse.Namespace) -> Setup:
    """The setup for `jaxtat plan`."""
    if options.detectors_from:
        scan, options = scan_of(changed(options, file=options.detectors_from))
    else:
        positions = _positions(options)
        n = 1 if positions is None else len(positions)
        scan = Scan("circular_integrals", np.zeros((n, 1)))  # geometry alone
        scan = with_facts(scan, scanner=options.scanner, detectors=positions)
    return setup_in_plane(scan, choose(scan, **for_plan(scan, given(options, scan))))


def for_plan(scan: Scan, asked: dict[str, Any]) -> dict[str, Any]:
    """Choices of a plan: with one speed of sound, unless two are asked for.

    A plan is for many records, of which this is one.
    """
    of_two = any(asked[name] not in (None, "disk") for name in (*OF_BODY, *OF_TWO_SPEEDS))
    return asked if of_two or scan.kind != "pressure" else asked | {"two_speeds": False}


def setup_in_plane(scan: Scan, choices: Choices) -> Setup:
    """The problem of a plan, or ValueError for a scan in space."""
    facts_of(scan)
    return setup_of(scan, choices)


def require_formula(choices: Choices) -> None:
    """Raise ValueError where images are fitted: there is nothing to plan."""
    if choices.model_based:
        why = dict(choices.reasons)["model_based"]
        raise ValueError(
            f"{why}. Images are fitted then, without densities: leave out the options of "
            "densities, or take a smaller region."
        )


def plan_for(options: argparse.Namespace, setup: Setup) -> ReconstructionPlan:
    """Build the plan of the options, up to the chosen frequency."""
    return build_plan(
        setup,
        _rule(options),
        method=_method(options),
        precision="single" if options.single else "double",
        progress=not options.quiet,
    )


def require_size(scan: Scan, choices: Choices) -> None:
    """Raise ValueError for rows and radii that are not the data's, and for too many pixels.

    Before any work; warns of long work.
    """
    rows = choices.order or (-1,)
    if not 0 <= min(rows) <= max(rows) < scan.n_detectors:
        raise ValueError(
            f"the settings are for rows {min(rows)} to {max(rows)} of the data, the scan has "
            f"{scan.n_detectors}: they are of another scan."
        )
    if "use" not in choices.user_set and len(rows) < scan.n_detectors:
        raise ValueError(
            f"the settings are for {len(rows)} detectors, the scan has {scan.n_detectors}: they "
            "are of another scan."
        )
    if scan.kind != "pressure":
        require_radii(scan.n_samples, choices.n_radii)
    region = choices.region
    if isinstance(region, Disk):  # in space nothing is done before
        polar_grid(region, choices.grid, choices.radii, choices.max_frequency, None)


def require_same(scan: Scan, choices: Choices, plan: ReconstructionPlan) -> None:
    """Raise ValueError for a plan made for other detectors or radii: its image would be wrong."""
    points, planned = facts_of(scan).points[list(choices.channels)], np.asarray(plan.curve.points)
    if points.shape != planned.shape:
        raise ValueError(
            f"the data have {len(points)} detectors, the geometry has {len(planned)}: choose them "
            "with --use, or use another plan."
        )
    off = float(np.abs(points - planned).max())
    if off > SAME * float(np.abs(planned).max()):
        raise ValueError(
            f"the plan was built for other detectors (positions differ by up to {off:.3g}): "
            "build one for this scan."
        )
    own = scan.known.get("radii")
    if own is None or own.shape != plan.radii.shape or scan.kind == "pressure":
        return
    off = float(np.abs(own - np.asarray(plan.radii)).max())
    if off > SAME * float(np.max(own)):
        raise ValueError(
            f"the plan was built for other radii (they differ by up to {off:.3g}): "
            "build one for this scan."
        )


def _rows_of(plan: ReconstructionPlan, scan: Scan) -> np.ndarray:
    """Rows of the plan's detectors, which leave out bad ones; all, if the scan has others."""
    every = np.arange(scan.n_detectors)
    if in_space(scan):
        return every
    points, planned = np.asarray(in_plane(scan.known["detectors"])), np.asarray(plan.curve.points)
    distance = np.linalg.norm(planned[:, None] - points, axis=-1)
    rows = distance.argmin(axis=1)
    same = distance.min(axis=1).max() <= SAME * np.abs(planned).max()
    return rows if same and len(set(rows)) == len(rows) else every


def chosen(use: str | None, n: int, option: str = "--use", what: str = "detectors") -> np.ndarray:
    """Indices of the slices in ``use``, all n by default.

    >>> chosen("6:8,0:2", 8).tolist()
    [6, 7, 0, 1]
    """
    if use is None:
        return np.arange(n)
    pieces = zip(use.split(","), slices(use, option), strict=True)
    return np.concatenate([_piece(text, piece, n, option, what) for text, piece in pieces])


def _piece(text: str, piece: slice, n: int, option: str, what: str) -> np.ndarray:
    """Indices of one slice; one that reaches beyond the n items is refused, not clipped."""
    indices = np.arange(n)[piece]
    if indices.size == 0 or any(abs(bound) > n for bound in (piece.start, piece.stop) if bound):
        raise ValueError(f"{option} {text}: there are {n} {what}, 0 to {n - 1}.")
    return indices


def _positions(options: argparse.Namespace) -> np.ndarray | None:
    """Positions of --arc or --ring."""
    if options.arc:
        radius, cut, n = options.arc
        return np.asarray(circular_arc(radius, cut, int(n)).points)
    if options.ring:
        radius, n = options.ring[0], int(options.ring[1])
        theta = 2 * np.pi * np.arange(n) / n
        return radius * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    return None


def _rows(scan: Scan, use: str | None) -> Scan:
    """The scan of some of its rows, read frame by frame."""
    if use is None:
        return scan
    rows = chosen(use, scan.n_detectors)
    if isinstance(scan.data, np.ndarray):
        return replace(scan, data=scan.data[..., rows, :])
    shape = (scan.n_frames, len(rows), scan.n_samples)
    data = scan.data
    return replace(
        scan, data=LazyFrames(shape, data.dtype, lambda frames: data[frames][:, rows]), known={}
    )


def _method(options: argparse.Namespace) -> str:
    if options.series:
        return "series"
    return "collocation" if options.collocation else "auto"


def _rule(options: argparse.Namespace) -> Regularization | None:
    if options.series:
        return None
    if options.j_max is not None:
        return FixedRank(options.j_max)
    if options.sigma_min is not None:
        return SingularValueCutoff(options.sigma_min)
    return None if options.K is None else NormBound(options.K)
