"""How the image of a scan is made: by a fit under constraints, or by the formula.

Measured records of pressure are fitted, with f >= 0 and total variation: they lack low frequencies
and hold noise, and detectors on an open arc do not see all edges. On 48 simulated scans images
without options have a median error of 0.22, those of the formula 0.64
(`docs/automatic_choices.md`). Where two-dimensional waves of one speed are recorded on a curve that
every line through the region meets, by detectors near enough for the image's waves, nothing is
missing, and the formula is more accurate; of detectors so far apart that the waves are twice as
fine as these tell, fits are, and through a body of another speed, where constraints make good what
is wrong with the body. In space records are fitted too: for detectors off rings the formula takes
dense systems of all of them at every frequency, which are slower than a fit and see nothing of what
is missing.

Integrals over circles are fitted as well: the formula takes them for exact, and of 256 detectors
on arcs of 360 to 115 degrees its images of disks are off by 0.3 to 0.9 without noise and by 0.9 to
4 with 5 % of it, fits by 0.03 to 0.11. Of smooth bodies without noise both are as good. Integrals
of f >= 0 are nowhere negative: whether they are says whether negative pixels are allowed.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from ..base.choice_table import GUESSED, LIKELY, OF_CONSTRAINTS, SURE
from ..base.units import ROUNDING, Units
from ..geometry import Region, visibility
from ..io import Scan
from .acquisition import facts_of, typical_frame
from .choices import Choices
from .estimate import Estimate
from .parameters import Parameters
from .preprocess import Acquisition, AcquisitionInSpace
from .resolution import FINER, sampled_by_detectors, with_waves_of_fit

OF_FORMULA = ("alpha", "low_pass", "inversion")  # choices that mean nothing to a fit
ADDS = "light that is absorbed only adds pressure; --signed allows f < 0"
NEGATIVE = 0.02  # share of the square of integrals below 0, which 20 % of noise would have
BETTER = "more accurate for measured pressure; --direct for the formula"
BETTER_IN_SPACE = "more accurate on simulated volumes of sparse arrays; --direct for the formula"
BETTER_OF_INTEGRALS = "more accurate with noise or for sharp edges; --direct for the formula"
EDGES = "total variation: for objects with edges"
FIT = {
    "nonnegative": Estimate(True, ADDS, LIKELY),
    "weight": Estimate(None, "balances penalty and misfit", LIKELY),
}


def laser_energy(record: Acquisition | AcquisitionInSpace, p: Parameters) -> Parameters:
    """Whether frames are divided by the energy of their pulses: said where the file has it."""
    if "laser_energy" in record.scan.known:
        return p.with_(laser_energy=Estimate(True, "in the file; the image is per unit of it"))
    if p.given.get("laser_energy"):
        raise ValueError("laser_energy is wanted, but the file has no energies of its pulses.")
    return p.fixed(laser_energy=False)


def constraints(record: Acquisition | AcquisitionInSpace, p: Parameters) -> Parameters:
    """The last step, and whether images are fitted: a given penalty implies it."""
    p = p.with_(inversion=Estimate("fourier", "the faster way to the same image"))
    asked = [name for name in OF_CONSTRAINTS if p.given.get(name)]
    say_so = {"nonnegative": False, "weight": 0}  # too
    asked += [n for n, value in say_so.items() if p.gives(n) and p.given[n] == value]
    expected = p.estimates.get("model_based")
    if p.given.get("model_based") is False:
        _require_direct(asked, expected)
    p = p.fixed(penalty="tv", nonnegative=False, weight=None)
    if not (asked or expected):
        return p.fixed(model_based=False)
    if expected is None:
        why = "given" if "model_based" in asked else f"{asked[0]} is given"
        expected = Estimate(True, why)
    _require_no_formula(p, expected)
    _require_whole_region(p)
    fit = FIT | {"penalty": _penalty(p["band"], p.units)}
    if record.scan.kind != "pressure":
        fit["nonnegative"] = _of_integrals(record.scan)
    return p.replaced(model_based=expected._replace(grade=SURE)).with_(**fit)


def _penalty(band: tuple[float, float] | None, units: Units) -> Estimate:
    """And what follows from it alone, where a record lacks low frequencies."""
    if band is None or not band[0] > 0:
        return Estimate("tv", EDGES, GUESSED)
    why = f"levels inside bodies follow from it, edges from the record ({units.of_band(*band)})"
    return Estimate("tv", f"{EDGES}; {why}", GUESSED)


def _of_integrals(scan: Scan) -> Estimate:
    """Whether their image is nowhere negative."""
    values = np.nan_to_num(typical_frame(scan))
    if np.sum(np.minimum(values, 0) ** 2) > NEGATIVE * np.sum(values**2):
        return Estimate(False, "integrals are negative, and so is the image in places", LIKELY)
    return Estimate(True, "integrals are hardly anywhere negative; --signed allows f < 0", LIKELY)


def _require_direct(asked: list[str], expected: Estimate | None) -> None:
    """Raise ValueError where the formula is asked for and cannot be, or constraints are too."""
    if expected is not None:
        raise ValueError(f"the direct image is asked for, but {expected.why}: leave that out.")
    if asked:
        raise ValueError(
            f"the direct image is asked for, and {asked[0]}, which is of fits: leave one out."
        )


def _require_no_formula(p: Parameters, fitted: Estimate) -> None:
    asked = [name for name in OF_FORMULA if p.gives(name)]
    if asked:
        raise ValueError(
            f"{asked[0]} is of the formula, but images are fitted here "
            f"({fitted.why}): leave it out."
        )


def _require_whole_region(p: Parameters) -> None:
    """Raise ValueError for a fit whose pixels leave out sources: others would take their place."""
    across, radius = float(p["half_width"]), float(p["region_radius"])
    if not _covers(across, radius, p["region_size"], p.estimates["region_radius"].grade):
        length = p.units.of_length
        raise ValueError(
            f"half_width is {length(across)}, but images are fitted with pixels all over the "
            f"region, of radius {length(radius)}: leave it out, make the region smaller, or take "
            "the formula (model_based=False, --direct)."
        )


def _covers(half_width: float, radius: float, size: Any, grade: str) -> bool:
    """Whether pixels up to ``half_width`` from the middle are where sound in a region comes from.

    A quarter of it may be to spare. Pixels that are asked for tell more than a region's guess.
    """
    return grade == GUESSED or half_width > 0.75 * (radius if size is None else max(size) / 2)


def with_best_method(scan: Scan, choices: Choices) -> Choices:
    """Choices with the more accurate method, unless they say which one is wanted.

    A given alpha, low pass or inversion asks for the formula, and so do pixels of a part of the
    region; ``model_based`` says it outright.

    Args:
        scan: any.
        choices: of `choose`.
    """
    pressure = scan.kind == "pressure"
    if choices.model_based:
        return with_waves_of_fit(scan, choices) if pressure else choices
    if "model_based" in choices.user_set:
        return choices
    asked = [name for name in OF_FORMULA if name in choices.user_set]
    if asked:
        return choices.with_reason("model_based", f"{asked[0]} is of the formula", SURE)
    wanted = choices.region_radius, choices.region_size, choices.grade("region_radius")
    if not _covers(choices.half_width, *wanted):
        why = "pixels show a part of the region, and a fit needs all of it"
        return choices.with_reason("model_based", why, SURE)
    if not pressure:
        fit = FIT | {"nonnegative": _of_integrals(scan)}
        return _fitted(choices, BETTER_OF_INTEGRALS, fit)
    if choices.model == "2d" and choices.water_speed is None and _nothing_is_missing(scan, choices):
        why = "two-dimensional waves, and every line through the region meets the detectors' curve"
        return choices.with_reason("model_based", why, LIKELY)
    fitted = _fitted(choices, BETTER_IN_SPACE if choices.in_space else BETTER, FIT)
    return with_waves_of_fit(scan, fitted)


def _fitted(choices: Choices, why: str, fit: dict[str, Estimate]) -> Choices:
    penalty = _penalty(choices.band, choices.units)
    fit = {"model_based": Estimate(True, why, LIKELY), "penalty": penalty, **fit}
    fitted = replace(choices, **{name: e.value for name, e in fit.items()})
    for name, e in fit.items():
        fitted = fitted.with_reason(name, e.why, e.grade)
    return fitted


def _nothing_is_missing(scan: Scan, choices: Choices) -> bool:
    """Whether detectors see every line through the region, and sample the image's waves.

    Of simulated scans of 76 and 38 detectors, whose waves are twice as fine, the formula had errors
    of 0.09 to 0.15, fits of 0.03 to 0.11 (5 of 5 better); of 8 others 4 fits were worse, 1 better.
    """
    facts, region = facts_of(scan), choices.region
    curve = choices.curve(facts.points)
    assert isinstance(region, Region) and facts.times is not None
    if float(visibility(curve, region).invisible_fraction) > 0:
        return False
    sampled = sampled_by_detectors(curve, region, facts.times)
    return choices.max_frequency < FINER * sampled * (1 - ROUNDING)
