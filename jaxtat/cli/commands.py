"""The commands. Heavy imports wait until one is run, so that --help is quick."""

import argparse
import logging
import sys
import time
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..base.option_values import OME_ZARR
from .option_checks import wants_plan


def paper(options: argparse.Namespace) -> None:
    """``jaxtat paper``."""
    from ..paper.run import paper_table, run_paper

    start = time.perf_counter()
    metrics = run_paper(options.out, progress=not options.quiet)
    print(paper_table(metrics))
    _report(options, f"figures and metrics.json are in {options.out}", start)


def plan(options: argparse.Namespace) -> None:
    """``jaxtat plan``."""
    from ..io.plans import require_plan_or_new, save_plan
    from .inputs import plan_for, setup_of_plan

    start = time.perf_counter()
    require_plan_or_new(options.out)
    built = plan_for(options, setup_of_plan(options))
    save_plan(built, options.out)
    _report(options, _accuracy(built), start)
    _report(options, f"plan written to {options.out}", start)


def info(options: argparse.Namespace) -> None:
    """``jaxtat info``."""
    from ..scans import choose, describe, with_best_method
    from ..scans.info import describe_without_region
    from ..scans.region import NoRegion
    from .hints import suggestions
    from .inputs import given, scan_of

    scan, options = scan_of(options)
    asked = given(options, scan)
    try:
        with _long_work_told(quiet=False):
            choices = choose(scan, **asked)
    except NoRegion as error:
        if options.json:
            raise
        print(f"{describe_without_region(scan, asked['length_unit'])}\n\nNo image yet: {error}")
        return
    if wants_plan(options):
        choices = choices.regularised_by_plan()
    else:
        choices = with_best_method(scan, choices)
    if options.json:
        _write_json(options, choices)
    if options.json != "-":
        print(f"{describe(scan, choices)}\n\n{suggestions(options, scan, choices)}")


def reconstruct(options: argparse.Namespace) -> None:
    """``jaxtat reconstruct``."""
    from ..io.images import require_no_record, require_suffix

    if Path(options.file).is_dir():
        from .folders import reconstruct_folder

        return reconstruct_folder(options)
    start = time.perf_counter()
    if options.out.endswith(OME_ZARR):
        from ..interop.labelled_images import require_ome_zarr

        require_ome_zarr(options.out)
    else:
        require_suffix(options.out)  # and the package that writes it
    if not options.format:  # which adds an image to a record
        require_no_record(Path(options.out))
    scan, choices, plan, options = prepared(options, start, fits=not options.trial)
    if options.json:
        _write_json(options, choices)
    if options.trial:
        return _sheet(options, scan, choices, start)
    if options.format == "patato":
        return _to_patato(options, scan, choices, plan, start)
    from .image_file import write_image

    report = write_image(options, scan, choices, plan)
    if report:
        _report(options, report, start)
    _report(options, f"image written to {options.out}", start)


def _to_patato(options, scan, choices, plan, start: float) -> None:
    from ..interop import save_patato
    from ..interop.patato_files import require_patato
    from ..scans import reconstruct as reconstruct_scan
    from ..scans import standard_deviations
    from .image_file import inputs_of, settings_of

    inputs = inputs_of(options)
    require_patato(options.out, scan, inputs)
    result = reconstruct_scan(scan, choices, plan=plan, progress=not options.quiet)
    if result.report:
        _report(options, result.report, start)
    deviation, settings = standard_deviations(scan, choices, plan=plan), settings_of(options)
    save_patato(options.out, scan, result, deviation=deviation, settings=settings, inputs=inputs)
    without = "" if deviation is not None else "; without standard deviations"
    _report(options, f"images are in {options.out}, for PATATO{without}", start)


def _write_json(options: argparse.Namespace, choices) -> None:
    """The choices as JSON, in a file or on standard output."""
    import json

    from ..base.atomic import replacing
    from ..scans import as_json

    text = json.dumps(as_json(choices), indent=2, allow_nan=False)
    if options.json == "-":
        print(text)
        return
    with replacing(options.json) as new:
        new.write_text(text + "\n")


def _sheet(options: argparse.Namespace, scan, choices, start: float) -> None:
    """A picture for each value of --try."""
    import numpy as np

    from ..base.atomic import replacing
    from ..base.choice_table import choice_named
    from ..plotting import contact_sheet
    from ..scans import trials
    from .inputs import given
    from .option_checks import trial

    name, values = trial(options.trial)
    choice = choice_named(name)
    assert choice.shown is not None
    panels = []
    for result in trials(scan, choices, given(options, scan), name, values):
        title = choice.shown(result.choices)
        inside = np.asarray(result.region.contains(result.grid.points))
        image = np.reshape(result.image, result.grid.shape)
        panels.append((np.where(inside, image, np.nan), result.grid, title))
        _report(options, f"{name} {title}", start)
    figure = contact_sheet(panels, unit=choices.units.length)
    now = choice.shown(choices)
    figure.suptitle(f"{name}, otherwise {now} ({choices.grade(name)})", fontsize=10)
    with replacing(options.out) as new:
        figure.savefig(new, dpi=110)
    _report(options, f"sheet written to {options.out}", start)


def report(options: argparse.Namespace) -> None:
    """``jaxtat report``."""
    from ..reporting import report_scan
    from .image_file import inputs_of

    start = time.perf_counter()
    scan, choices, plan, options = prepared(options, start, fits=True)
    report_scan(
        options.out,
        scan,
        choices,
        plan=plan,
        frame=options.frame,
        sigma=options.noise,
        uncertainty_pixels=options.uncertainty_pixels,
        title=Path(options.file).name,
        inputs=inputs_of(options),
        unit=options.length_unit,
        progress=not options.quiet,
    )
    _report(options, f"page written to {options.out}", start)


def stream(options: argparse.Namespace) -> None:
    """``jaxtat stream``."""
    import numpy as np

    from ..streams import live
    from ..streams import stream as run_stream
    from .streaming import frames_from, sink_at

    start = time.perf_counter()
    scan, choices, plan, options = prepared(options, start)
    dtype = scan.data.dtype if options.type is None else np.dtype(options.type)
    to_images = live(scan, choices, plan=plan)
    shape = (scan.n_detectors, scan.n_samples)
    frames = frames_from(options.source, shape, dtype, options.follow)
    sink = sink_at(options.out, options.format, to_images.setup, choices)
    source = "standard input" if options.source == "-" else options.source
    _report(options, f"ready for raw frames from {source}", start)
    outcome = run_stream(
        to_images,
        frames,
        sink,
        dtype=dtype,
        drop=options.drop,
        note=lambda line: print(f"jaxtat: note: {line}", file=sys.stderr),
    )
    _report(options, str(outcome), start)
    if outcome.ended not in ("", "interrupted"):
        raise ValueError(outcome.ended)


def view(options: argparse.Namespace) -> None:
    """``jaxtat view``."""
    from ..base.optional_packages import optional
    from ..viewer import PIXELS
    from ..viewer import view as view_scan
    from .inputs import FACTS

    start = time.perf_counter()
    optional("bokeh", "jaxtat view", "view")
    if wants_plan(options):
        raise ValueError("jaxtat view turns alpha, which a plan does not have: leave out --K.")
    scan, choices, _, options = prepared(options, start, pixels=PIXELS)
    facts = {name: getattr(options, name, None) for name in FACTS if name != "frames"}
    viewer = view_scan(
        scan, choices, facts=facts, source=options.file, folder=options.folder, port=options.port
    )
    print(f"{viewer.address}\nuntil Ctrl-C; the address is for you alone", flush=True)
    if not options.no_browser:
        webbrowser.open(viewer.address)
    try:
        viewer.wait()
    except KeyboardInterrupt:
        viewer.close()


def sample(options: argparse.Namespace) -> None:
    """``jaxtat sample``."""
    from ..base.atomic import require_new
    from ..io.datasets import sample_scan

    start = time.perf_counter()
    require_new(options.out)  # it may be somebody's record
    sample_scan(options.out)
    _report(options, f"scan written to {options.out}", start)


def prepared(
    options: argparse.Namespace, start: float, *, fits: bool = False, pixels: int | None = None
):
    """Scan, choices, plan (or None) and options of a command.

    With --repeat they are those of an earlier image. ``fits``: images are fitted where that is more
    accurate. ``pixels``: of images in the plane, where no option says how many.
    """
    from ..io.plans import load_plan
    from ..scans import choose, integrals, with_best_method
    from ..scans.acquisition import in_space
    from .inputs import (
        for_plan,
        given,
        plan_for,
        repeated,
        require_formula,
        require_same,
        require_size,
        scan_of,
        setup_in_plane,
    )

    choices = None
    if options.repeat:
        choices, options = repeated(options)
    plan = load_plan(options.plan) if options.plan else None
    scan, left = scan_of(options, plan)
    if choices is None:
        options_set = given(left, scan, plan)
        if options_set["pixels"] is None and not in_space(scan):
            options_set["pixels"] = pixels
        if plan is not None or wants_plan(options):
            options_set = for_plan(scan, options_set)
        with _long_work_told(options.quiet):
            choices = choose(scan, **options_set)
        require_size(scan, choices)
        if fits and plan is None and not wants_plan(options):
            choices = with_best_method(scan, choices)
    else:
        require_size(scan, choices)
    if plan is not None or wants_plan(options):
        choices = choices.regularised_by_plan()
    _report(options, f"{options.file}\n{choices.table()}", start)
    if plan is not None:
        require_same(scan, choices, plan)
    elif wants_plan(options):
        require_formula(choices)
        setup = setup_in_plane(scan, choices)
        integrals(scan, choices, setup, scan.frame(0))  # refused before anything is built
        plan = plan_for(options, setup)
    if plan is not None:
        _report(options, _accuracy(plan), start)
    return scan, choices, plan, options


@contextmanager
def _long_work_told(quiet: bool) -> Iterator[None]:
    """While choices are made, say on stderr what takes long, unless all is to be quiet."""
    log, told = logging.getLogger("jaxtat.scans"), logging.StreamHandler()
    told.setFormatter(logging.Formatter("jaxtat: %(message)s"))
    level = log.level
    if not quiet:
        log.addHandler(told)
        log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(told)
        log.setLevel(level)


def _accuracy(plan) -> str:
    residual, gain = plan.report.residual, plan.report.norm / plan.report.unit_norm[:, None]
    return (
        f"{plan.curve.n_detectors} detectors, {len(plan.frequencies)} frequencies x "
        f"{len(plan.angles)} directions; "
        f"plane waves on the region's boundary to {float(residual.mean()):.1e} (mean), "
        f"{float(residual.max()):.1e} (worst); norm {float(gain.mean()):.2f} N (mean)"
    )


def _report(options: argparse.Namespace, text: str, start: float) -> None:
    if not options.quiet:
        print(f"[{time.perf_counter() - start:6.1f} s] {text}")
