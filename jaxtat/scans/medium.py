"""Acoustic model and speeds of sound by the file, and by sizes until images tell them."""

import math
from typing import Any

import numpy as np
from jaxtyping import Float

from ..base.choice_table import GUESSED, LIKELY, SURE
from ..io import Scan
from ..records.signal_power import tail_share
from .acquisition import SLOWEST, Facts, nominal_water_speed
from .estimate import Estimate, Source
from .parameters import Parameters

OFFSET = 3.0  # over the sound's deviation, of a converter's counts; waves are about zero
TAIL = 0.1  # of `tail_share`: less is no tail of two-dimensional waves
SUPPOSED = 0.25  # of the detectors' radius: as far a body reaches from the middle, if not known
OF_BODY = ("water_speed", "body_radius", "body_center", "body_axes", "body_angle")
ROUNDED = 1e-3  # of a radius beside half axes: as a table or a command line has it


def acoustic_model(facts: Facts, frame: Float[np.ndarray, "detectors samples"]) -> Estimate:
    """By size, sampling rate, counts and tail; of a scanner's floats in the plane left to images.

    Args:
        frame: typical.
    """
    if nominal_water_speed(facts.units) is None:
        return Estimate("2d", "sizes are not a scanner's: two-dimensional waves", LIKELY)
    if facts.in_space:
        why = "detectors in space, of a scanner's size: focused into the plane"
        return Estimate("in-plane", why, LIKELY)
    known = np.where(np.isfinite(frame), frame, 0.0)
    offset = np.median(np.abs(np.median(known, axis=1)))
    if (known == np.round(known)).all() or offset > OFFSET * np.median(known.std(axis=1)):
        why = "a scanner's size, rate and counts: focused into the plane"
        return Estimate("in-plane", why, LIKELY)
    model, why = "2d", "a slow tail, and neither the integers nor the offset of a scanner"
    if tail_share(known) < TAIL:
        model, why = "in-plane", "a scanner's size and rate, and no slow tail"
    return Estimate(model, why, GUESSED, Source.NOMINAL)


def nominal_speed(scan: Scan, p: Parameters) -> Estimate:
    """The file's sound speed (the mean of a map or list); water's until it is estimated."""
    if "sound_speed" in scan.known:
        speeds = scan.known["sound_speed"]
        least, most = float(speeds.min()), float(speeds.max())
        if least == most:
            return Estimate(most, "from the file", SURE, Source.FILE)
        why = (
            "the mean of {shape} speeds in the file, {least:speed} to {most:speed}: images are "
            "made with one"
        )
        data = {"shape": " x ".join(map(str, speeds.shape)), "least": least, "most": most}
        return Estimate(float(speeds.mean()), why, GUESSED, Source.FILE, data=data)
    water = nominal_water_speed(p.units)
    if water is None:
        why = "none in the file, and sizes are not a scanner's: taken to be 1"
        return Estimate(1.0, why, GUESSED)
    why = "none in the file: about that of water, to be estimated"
    return Estimate(water, why, GUESSED, Source.NOMINAL)


def slowest(p: Parameters) -> float:
    """The least speed to search, over the nominal one, for which the record is long enough."""
    return SLOWEST if p.nominal("sound_speed") else 1.0


def path_speed(p: Parameters) -> float:
    """By which times are radii: the water's, where there are two [length/time]."""
    return float(p["water_speed"] or p["sound_speed"])


def single_speed(away: float | None, p: Parameters) -> float:
    """The sound speed; of two, the single one with the same travel time from the middle.

    Args:
        away: radius of the circle or sphere of the detectors; None if there is none [length].
        p: with the speed.
    """
    speed, water = float(p["sound_speed"]), p.given.get("water_speed")
    if water is None:
        return speed
    axes = p.given.get("body_axes")
    radius = p.given.get("body_radius") if axes is None else _equal_radius(axes)
    share = SUPPOSED if radius is None or away is None else float(radius) / away
    return 1 / (share / speed + (1 - share) / float(water))


def require_body_speed(p: Parameters) -> None:
    """Raise ValueError for a part of a body of another speed, where a speed is missing.

    Args:
        p: with the nominal speed.
    """
    asked = [name for name in OF_BODY if p.gives(name)]
    if asked and "water_speed" not in asked:
        raise ValueError(f"{asked[0]} is given, and the speed around it is not: water_speed.")
    if asked and p.nominal("sound_speed"):
        raise ValueError(
            "water_speed is given, and the body's own speed is neither given nor in the file: "
            "give sound_speed too. It is looked for if nothing else of the body is given."
        )


def require_body_inside(p: Parameters, radius: float | None) -> None:
    """Raise ValueError for a body that reaches the detectors, before any search.

    Args:
        p: with what is given.
        radius: of the detectors' circle, or sphere; None where they lie on none [length].
    """
    axes = p.given.get("body_axes")
    own = p.given.get("body_radius") if axes is None else max(axes)
    if own is not None and radius is not None and own >= radius:
        raise ValueError(
            f"{'body_radius is' if axes is None else 'the longer of body_axes is'} "
            f"{p.units.of_length(own)}, expected less than the "
            f"{p.units.of_length(radius)} of the detectors: lengths are in the "
            "unit of the positions."
        )


def body(_: Any, p: Parameters) -> Parameters:
    """The body of another speed than the water's, where that is given; by default the region."""
    asked = [name for name in OF_BODY if p.gives(name)]
    if asked and p["model"] == "none":
        raise ValueError(f"{asked[0]} is of pressure records: leave it out.")
    if not asked:
        return p.fixed(**dict.fromkeys(OF_BODY))
    p = p.with_(
        water_speed=Estimate(None),
        body_center=Estimate(p["region_center"], "the region's", GUESSED),
    )
    if not p.gives("body_axes"):
        radius = Estimate(p["region_radius"], "the region's", GUESSED)
        return p.with_(body_radius=radius).fixed(body_axes=None, body_angle=None)
    radius = Estimate(_equal_radius(p.given["body_axes"]))
    return p.with_(
        body_axes=Estimate(None), body_angle=Estimate(0.0, "none is given", GUESSED)
    ).replaced(body_radius=radius)


def _equal_radius(axes: Any) -> float:
    """Of the circle of the area of an ellipse."""
    return math.sqrt(axes[0] * axes[1])


def require_ellipse(p: Parameters) -> None:
    """Raise ValueError for half axes, an angle and a radius that do not go together.

    Args:
        p: with what is given.
    """
    axes, angle, radius = (p.given.get(n) for n in ("body_axes", "body_angle", "body_radius"))
    if axes is None:
        if angle is not None:
            raise ValueError("body_angle is given, and the half axes are not: body_axes.")
        return
    if not all(x > 0 and math.isfinite(x) for x in axes):
        raise ValueError(f"body_axes is {tuple(axes)}, expected two numbers above zero.")
    if angle is not None and not math.isfinite(angle):
        raise ValueError(f"body_angle is {angle}, expected a finite number of degrees.")
    own = _equal_radius(axes)
    if radius is not None and abs(radius - own) > ROUNDED * own:
        raise ValueError(
            f"body_radius is {p.units.of_length(radius)} beside body_axes, whose ellipse has the "
            f"area of a circle of {p.units.of_length(own)}: leave out the radius."
        )
