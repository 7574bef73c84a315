"""The region of interest of a scan: where sound comes from, or what all sides see."""

from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from ..base.checks import real_array, require_positive
from ..base.choice_table import GUESSED, LIKELY, SURE
from ..geometry import ArcFit, DetectorPoints, detector_curve, visible_disk
from ..geometry.regions import require_outside
from ..io import Scan
from ..records.source_extent import heard, sounding_disk
from .acquisition import Facts
from .choices import plane_region
from .estimate import Estimate, Source
from .medium import SUPPOSED, single_speed, slowest
from .onset_times import PAUSE, body_onsets, power_after
from .parameters import Parameters
from .preprocess import Acquisition, AcquisitionInSpace, known_radii

DEFAULT_SHARE = 0.75  # of the detectors' radius, where the record does not show it
SHARES = (0.1, 0.97)  # least and largest region radius over the arc's
UNTOLD = 0.5  # likewise, where sound seems to come from nowhere
LONGEST = 100.0  # radii of the arc: no record of a scanner is that long
WIDEST, NARROWEST = 20.0, 1e-3  # region over array, where both are in one unit of length
PREFIXES = 1e3, 1e-3  # of millimetres beside metres per second, and the reverse
MARGIN, SPREAD = 1.1, 2.0  # of the region: times as far as sound comes from, and deviations
MARGIN_IN_SPACE = 1.4  # sound from the rims of balls is weak
LITTLE = -0.5  # of the region's radius: a chord there leaves a fifth of the disk
WITHIN = "sound comes from within {reach:length}, and {spare:.0%} to spare"
COVERED = "as much as detectors and record (path {path:length}) cover"


class NoRegion(ValueError):
    """No region of interest follows from the detectors' positions."""


def with_rectangle(p: Parameters) -> Parameters:
    """With the size of a rectangle and the options that follow from it, or none.

    Raises:
        ValueError: for a size that is not above zero, or one beside the radius of a disk.
    """
    if not p.gives("region_size"):
        return p.fixed(region_size=None)
    size = p.given["region_size"]
    for name in ("region_radius", "region_cut"):
        if p.gives(name):
            raise ValueError(f"region_size is of a rectangle and {name} of a disk: give one.")
    sides = real_array("region_size", size, (2,))
    require_positive("region_size", sides)
    sides = np.asarray(sides)
    half, across = float(np.hypot(*sides)) / 2, float(sides.max()) / 2
    return p.with_(
        region_size=Estimate(size),
        region_radius=Estimate(half, "half the rectangle's diagonal", source=Source.USER),
        half_width=Estimate(across, "the rectangle", source=Source.USER),
    )


def region_of_sound(record: Acquisition, p: Parameters) -> Parameters:
    """The region from which sound comes; for detectors on no circle, the one that they see."""
    arc = record.facts.arc
    if arc is None:
        return _seen_region(record, p)
    p = _with_center(arc, p)
    speed = single_speed(arc.radius, p)
    points = record.points[record.good] - np.array(arc.center)
    disk, when = body_onsets(record, points, speed, not p.nominal("sound_speed"))
    path = float(record.times[-1]) * speed * slowest(p)
    # by first times alone, for a record that ends before sound from the far side
    begins = when._replace(ceases=np.zeros_like(when.ceases))
    near = sounding_disk(points, begins, speed, True)
    late = when.tells and path - arc.radius < near.reach < SHARES[1] * arc.radius
    disk = near if late else disk
    wanted = MARGIN * disk.reach + SPREAD * disk.deviation
    spare = wanted / max(disk.reach, 1e-3 * wanted) - 1
    data = {"reach": disk.reach, "spare": spare, "path": path}
    found = Estimate(wanted, WITHIN, LIKELY, Source.ESTIMATE, data=data)
    view = _field_of_view(record.scan, p["region_center"])
    if view is not None and view < wanted:
        found = Estimate(view, "the field of view in the file", SURE, Source.FILE, data=data)
    most = min(SHARES[1] * arc.radius, path - arc.radius)
    if late:  # fitted to what was recorded
        most = SHARES[1] * arc.radius
    found = _within(found, when.tells, arc.radius, most)
    p = p.with_(region_radius=found)
    toward = np.array([np.cos(arc.opening), np.sin(arc.opening)])
    sounds = float(disk.middle @ toward) + disk.radius
    if found.grade == GUESSED:  # the region is the most that the detectors cover
        sounds = SUPPOSED * arc.radius
    return _as_wide(_cut_at_opening(arc, p, sounds), found.grade)


def _within(found: Estimate, tells: bool, radius: float, most: float) -> Estimate:
    """The region's radius, between the least that a scan has and what is covered."""
    least, lost = SHARES[0] * radius, not tells and found.grade != SURE
    if (most if lost else found.value) < least:
        why = "half the circle: where sound comes from cannot be told"
        return found._replace(value=UNTOLD * radius, why=why, grade=GUESSED)
    if lost:
        why = f"where sound comes from cannot be told: {COVERED}"
    elif found.value > most:
        why = f"of {{wanted:length}}, {COVERED}"
    else:
        return found
    data = {**found.data, "wanted": found.value}
    return found._replace(value=max(least, most), why=why, grade=GUESSED, data=data)


def _as_wide(p: Parameters, grade: str) -> Parameters:
    return p.with_(half_width=Estimate(float(p["region_radius"]), "the region", grade))


def _with_center(arc: ArcFit, p: Parameters) -> Parameters:
    """With the region's centre, by default the middle of the detectors' circle.

    Raises:
        ValueError: for one beyond detectors that surround what they hear.
    """
    p = p.with_(region_center=Estimate(arc.center, "the middle of the detectors' circle"))
    apart = float(np.hypot(*(np.array(p["region_center"]) - np.array(arc.center))))
    if arc.span > np.pi and apart > arc.radius:
        raise ValueError(
            f"region_center is {apart:.4g} from the middle of the detectors' circle, beyond its "
            f"radius {arc.radius:.4g}: expected a point among the detectors, in their unit."
        )
    return p


def region_of_integrals(record: Acquisition, p: Parameters) -> Parameters:
    """Three quarters of the detectors' circle, or what they see, as far as the radii reach."""
    arc = record.facts.arc
    if arc is None:
        return _seen_region(record, p)
    p = _with_center(arc, p)
    why = "three quarters of the detectors' circle"
    share = _covered(record.scan, p, DEFAULT_SHARE * arc.radius, why, _distances(record, p))
    p = p.with_(region_radius=share._replace(grade=GUESSED))
    return _as_wide(_cut_at_opening(arc, p), GUESSED)


def _seen_region(record: Acquisition, p: Parameters) -> Parameters:
    """Around detectors on no circle: the largest disk that they see from all sides."""
    center, radius = p.user("region_center"), p.user("region_radius")
    if center is None or radius is None:
        center, radius = _largest_seen(record.facts, center)
    p = p.with_(region_center=Estimate(center, "the middle of the largest disk that is seen"))
    disk = _covered(record.scan, p, radius, "the largest disk that is seen", _distances(record, p))
    p = p.with_(region_radius=disk._replace(grade=GUESSED))
    p = p.with_(
        region_cut=Estimate(float(p["region_radius"]), "all of the disk"),
        region_angle=Estimate(0.0, "nothing is cut off"),
    )
    return _as_wide(p, GUESSED)


def _largest_seen(facts: Facts, center: Any) -> tuple[tuple[float, float], float]:
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


def _cut_at_opening(arc: ArcFit, p: Parameters, beyond: float = -np.inf) -> Parameters:
    """The region ends at the chord of the opening, unless sources reach beyond it.

    Of that the detectors see some edges, and the disk's image is better with than without them.

    Args:
        beyond: how far from the middle it sounds, towards the opening, if that is known [length].
    """
    radius = float(p["region_radius"])
    little_left = arc.chord < LITTLE * radius
    ends = arc.chord < radius and not (
        p.gives("region_radius") or beyond > arc.chord or little_left
    )
    why = "what lies beyond the arc's ends is not seen" if ends else "all of the disk"
    grade = GUESSED if ends and beyond == -np.inf else SURE  # who knows what sounds there
    if beyond > arc.chord and arc.chord < radius:
        why = "all of the disk: what sounds reaches beyond the arc's ends"
    return p.with_(
        region_cut=Estimate(float(arc.chord if ends else radius), why, grade),
        region_angle=Estimate(
            float(np.degrees(arc.opening)), "closed ring" if arc.closed else "the arc opens there"
        ),
    )


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


def free_circle(facts: Facts, p: Parameters) -> ArcFit:
    """The detectors' circle; of others the largest without any about what they see."""
    if facts.arc is not None:
        return facts.arc
    points = facts.points[facts.order]
    center, radius = p.user("region_center"), p.user("region_radius")
    if center is not None and radius is not None:
        arc = circle_without_detectors(points, center)
        return arc._replace(radius=min(arc.radius, 2 * float(radius)))
    return circle_without_detectors(points, _largest_seen(facts, center)[0])


def _distances(record: Acquisition, p: Parameters) -> Float[np.ndarray, " detectors"]:
    """Distances of the detectors from the region's centre."""
    return np.hypot(*(record.points - np.array(p["region_center"])).T)


def ball_of_sound(record: AcquisitionInSpace, p: Parameters) -> Parameters:
    """A ball about the sphere's centre from which sound comes, or its part that the cap sees."""
    facts = record.facts
    ball = Estimate(
        DEFAULT_SHARE * facts.radius, "three quarters of the detectors' sphere", GUESSED
    )
    if facts.times is not None:
        speed = single_speed(facts.radius, p)
        path = float(facts.times[-1]) * speed
        if not p.gives("region_radius"):
            require_scale(path, facts.radius, speed)
        reach = sounding_radius(record, p)
        if reach is not None and MARGIN_IN_SPACE * reach < ball.value:
            wanted = max(MARGIN_IN_SPACE * reach, SHARES[0] * facts.radius)
            data = {"reach": reach, "spare": MARGIN_IN_SPACE - 1}
            ball = Estimate(wanted, WITHIN, LIKELY, Source.ESTIMATE, data=data)
        most = path * slowest(p) - facts.radius
        if most < ball.value:
            ball = Estimate(most, "as much as the record covers", GUESSED)
    covered = _covered(record.scan, p, ball.value, ball.why, np.array([facts.radius]))
    p = p.with_(region_radius=ball._replace(value=covered.value, why=covered.why))
    cut, why = float(p["region_radius"]), "all of the ball"
    if not isinstance(facts.detectors, DetectorPoints):
        top = facts.radius * float(np.cos(float(facts.detectors.half_opening)))
        if top < cut and not p.gives("region_radius"):
            cut, why = top, "what lies beyond the cap's rim is not seen"
    return _as_wide(p.with_(region_cut=Estimate(cut, why)), ball.grade)


def sounding_radius(record: AcquisitionInSpace, p: Parameters) -> float | None:
    """Radius about the middle from which sound comes, by its times; None if unknown."""
    facts, speed = record.facts, single_speed(record.facts.radius, p)
    assert facts.times is not None
    quieted = record.frame - np.median(record.frame, axis=1, keepdims=True)
    power = power_after(-np.inf, quieted, facts.times, detrend=False)
    when = heard(power, PAUSE * facts.radius / speed)
    if not when.tells:
        return None
    points = np.asarray(record.scan.known["detectors"], float)[facts.order]
    offset = points - np.asarray(facts.detectors.center)
    return sounding_disk(offset, when, speed, not p.nominal("sound_speed")).reach


def _covered(scan: Scan, p: Parameters, wanted: float, why: str, distances: np.ndarray) -> Estimate:
    """A region's radius: as asked for, or as far as the radii of the data reach.

    Args:
        wanted, why: the radius without regard to the data [length].
        distances: of the detectors from the region's centre [length].

    Raises:
        ValueError: if they cover nothing, where no radius is given.
    """
    radii = known_radii(scan, p)
    if radii is None or p.gives("region_radius"):
        return Estimate(wanted, why)
    nearest, farthest = float(distances.min()), float(distances.max())
    most = min(nearest - float(radii[0]), float(radii[-1]) - farthest)
    if most <= SHARES[0] * wanted:
        raise ValueError(
            f"radii run from {radii[0]:.6g} to {radii[-1]:.6g}, and detectors are {nearest:.6g} to "
            f"{farthest:.6g} from the middle: their circles cover no region about it. Check that "
            "radii and positions are in the same unit of length, or give region_center and "
            "region_radius."
        )
    return Estimate(wanted, why) if wanted <= most else Estimate(most, "as much as the radii cover")


def require_scale(path: float, radius: float, speed: float) -> None:
    """Raise ValueError for a record too short for anything, or so long that units must differ.

    Args:
        path: of sound, until the record ends [length].
        radius: of the arc [length].
    """
    least = (1 + SHARES[0]) * radius
    if not least <= path <= LONGEST * radius:
        fits = [x for x in PREFIXES if least <= x * path <= LONGEST * radius]
        other = f" (--sound-speed {fits[0] * speed:.6g} would fit)" if fits else ""
        raise ValueError(
            f"at a sound speed of {speed:.6g} the record ends after a path of {path:.4g}, while "
            f"the detectors are {radius:.4g} from their middle: expected {least:.4g} to "
            f"{LONGEST * radius:.4g}. Check that positions, times and sound speed are in units "
            f"that fit each other{other}, and when the first sample was taken (start_time); for a "
            "part off the middle give region_center and region_radius."
        )


def require_units_alike(facts: Facts, p: Parameters) -> None:
    """Raise ValueError for a region, or a record, that is in hardly the array's unit of length.

    Args:
        facts: of a pressure record.
        p: with the speed, and what is given of the region.
    """
    assert facts.times is not None
    points, units = facts.points[facts.order], facts.units  # of the detectors that are used
    across = float(np.ptp(points, axis=0).max())
    array = f"the detectors are {units.of_length(across)} across"
    size, radius = p.given.get("region_size"), p.given.get("region_radius")
    wide = max(size) if size is not None else None if radius is None else 2 * radius
    if wide is not None and not NARROWEST * across <= wide <= WIDEST * across:
        raise ValueError(
            f"a region {units.of_length(float(wide))} across is given, while {array}: check that "
            "both are in one unit of length."
        )
    path = float(facts.times[-1]) * p["sound_speed"]
    elsewhere = facts.arc is not None and not p.gives("region_radius")  # by `require_scale`
    if path > LONGEST * across and not elsewhere:
        raise ValueError(
            f"at a sound speed of {p['sound_speed']:.6g} the record ends after a path of "
            f"{units.of_length(path)}, while {array}. Check that positions, times and sound speed "
            "are in units that fit each other: metres, seconds and m/s always do."
        )
    if wide is not None and p.gives("region_center") and not p.gives("region_cut"):
        whole = {"region_cut": np.inf, "region_angle": 0.0}
        about = {"region_size": size, "region_radius": radius}
        about["region_center"] = p.given["region_center"]
        require_outside(jax.device_put(points), plane_region(about | whole))
