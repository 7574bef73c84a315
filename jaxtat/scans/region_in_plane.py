"""The region of interest of a scan in the plane: where sound comes from, or what all sides see."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from ..base.checks import real_array, require_positive
from ..base.choice_table import GUESSED, LIKELY, SURE
from ..geometry import ArcFit, detector_curve, visible_disk
from ..io import Scan
from .acquisition import Facts
from .found import SHARES, Found, NoRegion, covered, slowest
from .hearing import Sound, body_heard, near_side_heard

MARGIN, SPREAD = 1.1, 2.0  # of the region: times as far as sound comes from, and deviations
SUPPOSED = 0.25  # of the detectors' radius: as far a body reaches from the middle, if not known
LITTLE = -0.5  # of the region's radius: a chord there leaves a fifth of the disk


def region_of_sound(
    scan: Scan, facts: Facts, found: Found, sound: Sound, speed: float, good: np.ndarray
) -> None:
    """Take the region from which sound comes; for detectors on no circle, the one that they see.

    Args:
        sound: of the good detectors.
        speed: assumed [length/time].
        good: which of the ordered detectors are used.
    """
    arc = facts.arc
    if arc is None:
        seen_region(facts, found)
        return
    assert facts.times is not None
    center = center_within(arc, found)
    points = facts.points[facts.order][good] - np.array(arc.center)
    known = "sound_speed" not in found.to_estimate
    heard = body_heard(sound, points, speed, known)
    body, tells = heard.disk, heard.when.tells
    path = float(facts.times[-1]) * speed
    path *= slowest(found)
    near = near_side_heard(heard, points, speed)
    late = tells and path - arc.radius < near.reach < SHARES[1] * arc.radius
    body = near if late else body
    wanted = MARGIN * body.reach + SPREAD * body.deviation
    length, grade = facts.units.of_length, LIKELY
    spare = wanted / max(body.reach, 1e-3 * wanted) - 1
    why = f"sound comes from within {length(body.reach)}, and {spare:.0%} to spare"
    view = _field_of_view(scan, center)
    if view is not None and view < wanted:
        wanted, why, grade = view, "the field of view in the file", SURE
    least, most = SHARES[0] * arc.radius, min(SHARES[1] * arc.radius, path - arc.radius)
    if late:  # fitted to what was recorded
        most = SHARES[1] * arc.radius
    if wanted < least:
        why = "a tenth of the arc: where sound comes from cannot be told"
        wanted, grade = least, GUESSED
    if not tells and grade != SURE:
        much = f"as much as detectors and record (path {length(path)}) cover"
        why = f"where sound comes from cannot be told: {much}"
        wanted, grade = max(least, most), GUESSED
    elif wanted > most:
        why = f"of {length(wanted)}, as much as detectors and record (path {length(path)}) cover"
        wanted, grade = max(least, most), GUESSED
    radius = float(found.take("region_radius", wanted, why, grade))
    toward = np.array([np.cos(arc.opening), np.sin(arc.opening)])
    told = grade != GUESSED  # the region is not the most that the detectors cover
    sounds = float(body.middle @ toward) + body.radius if told else SUPPOSED * arc.radius
    cut_at_opening(arc, found, radius, sounds)
    found.take("half_width", radius, "the region", grade)


def center_within(arc: ArcFit, found: Found) -> Any:
    """Take the region's centre, by default the middle of the detectors' circle.

    Raises:
        ValueError: for one beyond detectors that surround what they hear.
    """
    center = found.take("region_center", arc.center, "the middle of the detectors' circle")
    apart = float(np.hypot(*(np.array(center) - np.array(arc.center))))
    if arc.span > np.pi and apart > arc.radius:
        raise ValueError(
            f"region_center is {apart:.4g} from the middle of the detectors' circle, beyond its "
            f"radius {arc.radius:.4g}: expected a point among the detectors, in their unit."
        )
    return center


def found_with_rectangle(given: Mapping[str, Any], values: dict[str, Any]) -> Found:
    """Nothing taken yet but the size of a rectangle, and the options that follow from it.

    Raises:
        ValueError: for a size that is not above zero, or one beside the radius of a disk.
    """
    size = given.get("region_size")
    if size is None:
        return Found(given, values | {"region_size": None}, {}, {}, set(), {})
    for name in ("region_radius", "region_cut"):
        if given.get(name) is not None:
            raise ValueError(f"region_size is of a rectangle and {name} of a disk: give one.")
    sides = real_array("region_size", size, (2,))
    require_positive("region_size", sides)
    sides = np.asarray(sides)
    follows = {"region_radius": "half the rectangle's diagonal"}
    implied = {"region_radius": float(np.hypot(*sides)) / 2}
    if given.get("half_width") is None:
        follows["half_width"], implied["half_width"] = "the rectangle", float(sides.max()) / 2
    found = Found({**given, **implied}, values, {}, {}, set(), {}, follows)
    found.take("region_size", size, "given")
    return found


def seen_region(facts: Facts, found: Found, radii: np.ndarray | None = None) -> None:
    """Around detectors on no circle: the largest disk that they see from all sides.

    Args:
        radii: of the data, if they are known; the disk is no larger than they cover.
    """
    center, radius = (found.given.get(name) for name in ("region_center", "region_radius"))
    if center is None or radius is None:
        center, radius = largest_seen(facts, center)
    center = found.take("region_center", center, "the middle of the largest disk that is seen")
    radius, why = covered(found, radius, "that disk", radii, distances_of(facts, found))
    radius = float(found.take("region_radius", radius, why, LIKELY))
    found.take("region_cut", radius, "all of the disk")
    found.take("region_angle", 0.0, "nothing is cut off")
    found.take("half_width", radius, "the region", LIKELY)


def largest_seen(facts: Facts, center: Any) -> tuple[tuple[float, float], float]:
    """Middle and radius of the largest disk that detectors on no circle see from all sides.

    Args:
        center: of the disk, if that is given.

    Raises:
        NoRegion: if there is none.
    """
    seen = visible_disk(detector_curve(facts.points[facts.order]), center=center)
    if seen is None:
        raise NoRegion(
            "the detectors lie on no circle, and see no point from all sides: give --region-center "
            "and --region-size (or --region-radius); jaxtat warns of what is not seen."
        )
    (first, second), radius = seen
    return (float(first), float(second)), float(radius)


def cut_at_opening(arc: ArcFit, found: Found, radius: float, beyond: float = -np.inf) -> None:
    """The region ends at the chord of the opening, unless what sounds reaches beyond it.

    Of that the detectors see some edges, and the disk's image is better with than without them.

    Args:
        beyond: how far from the middle it sounds, towards the opening, if that is known [length].
    """
    little_left = arc.chord < LITTLE * radius
    whole = found.given.get("region_radius") is not None or beyond > arc.chord or little_left
    ends = arc.chord < radius and not whole
    cut = arc.chord if ends else radius
    why = "what lies beyond the arc's ends is not seen" if ends else "all of the disk"
    if arc.chord < radius and beyond > arc.chord:
        why = "all of the disk: what sounds reaches beyond the arc's ends"
    found.take("region_cut", float(cut), why)
    angle = float(np.degrees(arc.opening))
    found.take("region_angle", angle, "closed ring" if arc.closed else "the arc opens there")


def _field_of_view(scan: Scan, center: Any) -> float | None:
    """Radius of the disk about the region's centre that holds the file's field of view."""
    if "field_of_view" not in scan.known:
        return None
    low, high = np.asarray(scan.known["field_of_view"], float).reshape(3, 2).T
    spread = np.ptp(np.asarray(scan.known["detectors"]), axis=0)
    axes = [0, 1] if len(spread) == 2 else [k for k in range(3) if k != int(np.argmin(spread))]
    half = np.maximum(high[axes] - np.array(center), np.array(center) - low[axes])
    there = (half > 0).all() and (high > low)[axes].all()
    return float(np.hypot(*half)) if there else None


def circle_without_detectors(points: Float[np.ndarray, "detectors 2"], center: Any) -> ArcFit:
    """For other curves than arcs: the largest circle about the centre without detectors."""
    middle = (float(center[0]), float(center[1]))
    radius = float(np.hypot(*(points - np.array(middle)).T).min())
    return ArcFit(middle, radius, 0.0, 2 * np.pi, 0.0, 0.0, np.inf)


def distances_of(facts: Facts, found: Found) -> Float[np.ndarray, " detectors"]:
    """Distances of the detectors from the region's centre."""
    offset = facts.points[facts.order] - np.array(found.values["region_center"])
    return np.hypot(*offset.T)
