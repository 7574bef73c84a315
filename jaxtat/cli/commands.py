"""The commands. Heavy imports wait until one is run, so that --help is quick."""

import argparse
import json
import time


def paper(options: argparse.Namespace) -> None:
    """``jaxtat paper``."""
    from ..paper.run import paper_table, run_paper

    start = time.perf_counter()
    metrics = run_paper(options.out, progress=not options.quiet)
    print(paper_table(metrics))
    _report(options, f"figures and metrics.json are in {options.out}", start)


def plan(options: argparse.Namespace) -> None:
    """``jaxtat plan``."""
    from ..io.atomic import require_place
    from ..io.plans import save_plan
    from ..io.scans import load_scan
    from .setup import geometry, plan_for

    start = time.perf_counter()
    require_place(options.out)
    scan = load_scan(options.detectors_from) if options.detectors_from else None
    built = plan_for(options, geometry(options, scan))
    save_plan(built, options.out)
    _report(options, _accuracy(built), start)
    _report(options, f"plan written to {options.out}", start)


def reconstruct(options: argparse.Namespace) -> None:
    """``jaxtat reconstruct``."""
    from ..io.atomic import require_place
    from ..io.images import require_suffix, save_image
    from ..io.plans import load_plan
    from ..io.scans import load_scan
    from ..reconstruction import reconstruct as run
    from ..reconstruction import reconstruct_direct
    from ..reconstruction.direct import DEFAULT_ALPHA
    from .setup import (
        circular_integrals_of,
        geometry,
        low_pass,
        plan_for,
        require_free,
        wants_plan,
    )

    start = time.perf_counter()
    require_suffix(options.out)
    require_place(options.out)
    scan = load_scan(options.file)
    # what can be wrong with the data is found before anything is computed
    if options.plan:
        require_free(options)
        chosen_plan = load_plan(options.plan)
        where = chosen_plan.curve, chosen_plan.region, chosen_plan.grid, chosen_plan.radii
    else:
        where = geometry(options, scan)
        chosen_plan = None
    curve, region, grid, radii = where
    g = circular_integrals_of(scan, options, curve, radii)
    if chosen_plan is None and wants_plan(options):
        chosen_plan = plan_for(options, where)
    last = {"low_pass": low_pass(options), "inversion": options.inversion}
    if chosen_plan is None:
        alpha = options.alpha
        if alpha is None:
            alpha = 1e-3 if scan.kind == "pressure" else DEFAULT_ALPHA
        found = reconstruct_direct(*where, g, alpha, max_frequency=options.max_frequency, **last)
        image = found.image
        _report(options, _solved(found), start)
    else:
        _report(options, _accuracy(chosen_plan), start)
        image = run(chosen_plan, g, **last)
    settings = {
        name: value if isinstance(value, str | int | float | bool) else json.dumps(value)
        for name, value in vars(options).items()
        if name != "run" and value is not None
    }
    save_image(options.out, image, grid, region, settings)
    _report(options, f"image written to {options.out}", start)


def _solved(found) -> str:
    report = found.report
    return (
        f"{report.alpha.shape[0]} frequencies, alpha {float(report.relative_alpha.max()):.1e}; "
        f"systems solved to {float(report.residual.max()):.1e} (worst)"
    )


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
