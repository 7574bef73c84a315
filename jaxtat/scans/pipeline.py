"""The stages that estimate the parameters of a scan.

A scan passes a list of stages, each of which takes the record and the parameters and returns the
parameters with more estimates. Plane and space, pressure and integrals differ by their lists.
Nothing is remembered, nothing drawn by chance.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..base.choice_table import GUESSED, LIKELY, SURE, option_of
from ..base.units import Units
from ..io import Scan
from ..records import MODELS
from ..records.signal_power import RecordPower
from .acoustics import tell_acoustics
from .acoustics_in_space import tell_acoustics_in_space
from .acquisition import RESPONSE, Facts, facts_of, nominal_water_speed, typical_frame
from .all_speeds import about_center
from .angular_coverage import with_speed_seen_once
from .choices import IN_SPACE, Choices
from .estimate import Estimate, Source
from .laser_artefact import start_by_laser
from .medium import (
    acoustic_model,
    body,
    nominal_speed,
    require_body_inside,
    require_body_speed,
    require_ellipse,
)
from .method import constraints, laser_energy
from .noise import exact_integrals, noise_in_plane, noise_in_space
from .parameters import Parameters
from .preprocess import Acquisition, AcquisitionInSpace, preprocess_in_plane, preprocess_in_space
from .radii import radii_in_plane, radii_in_space, radii_of_integrals
from .region import (
    ball_of_sound,
    region_of_integrals,
    region_of_sound,
    require_scale,
    require_units_alike,
    with_rectangle,
)
from .resolution import band, resolution_in_plane, resolution_in_space
from .space import facts_around
from .start_time import start_and_speed, with_start_confirmed, with_start_untold

METHOD = laser_energy, constraints
PRESSURE = region_of_sound, body, resolution_in_plane, band, radii_in_plane, noise_in_plane, *METHOD
INTEGRALS = region_of_integrals, radii_of_integrals, exact_integrals, body, *METHOD
BALL = ball_of_sound, body, resolution_in_space, radii_in_space, noise_in_space, *METHOD
NO_SOUND = {"model": "none", "sound_speed": 1.0, "time_shift": 0.0, "dead_time": 0.0, "band": None}
_REGION_IN_PLANE = "region_angle", "region_center", "region_size"
NOT_IN_SPACE = "time_shift", *_REGION_IN_PLANE, "model", "body_axes", "body_angle"  # options


def choices_in_plane(scan: Scan, given: Mapping[str, Any]) -> Choices:
    """All choices for a scan in the plane; see `choosing.choose`."""
    if given.get("model") == IN_SPACE:
        raise ValueError(
            f"model is {IN_SPACE!r}, but the detectors lie in a plane: expected one of "
            f"{', '.join(MODELS)}."
        )
    facts = facts_of(scan, given.get("use"))
    facts = facts._replace(units=facts.units.in_length(given.get("length_unit")))
    p = with_rectangle(Parameters(given, facts.units))
    if scan.kind != "pressure":
        return _through(INTEGRALS, *_integrals(scan, facts, p)).choices()
    told = _through(PRESSURE, *_sound(scan, facts, p, {}))
    made = told.choices()
    made = with_speed_seen_once(scan, made) if told.nominal("sound_speed") else made
    return _with_start(scan, facts, p, told, made) if told.nominal("time_shift") else made


def _through(stages: tuple, record: Any, p: Parameters) -> Parameters:
    for stage in stages:
        p = stage(record, p)
    return p


def _with_start(
    scan: Scan, facts: Facts, p: Parameters, told: Parameters, made: Choices
) -> Choices:
    """Choices with the start estimated by images, where neither file nor user gives one.

    Args:
        p: before the stages.
        told: behind them.
        made: choices with the start of the file.
    """
    if nominal_water_speed(facts.units) is None or made.grade("sound_speed") == SURE:
        return made
    distance = float(np.hypot(*about_center(scan, made).T).mean())
    sure = made.grade("model") != GUESSED and made.water_speed is None
    start = start_and_speed(scan, made) if sure else None
    if start is None or (start.grade == GUESSED and not start.differs):
        return with_start_untold(made, distance)
    if not start.differs:
        return with_start_confirmed(made, start)
    images = start.estimates(told.estimates["model"])
    shifted = _through(PRESSURE, *_sound(scan, facts, p, images)).choices()
    # with a start that is wrong, as through two speeds, sound may seem to come from nowhere
    lost = shifted.grade("region_radius") == GUESSED != made.grade("region_radius")
    return with_start_untold(made, distance) if lost else shifted


def _sound(
    scan: Scan, facts: Facts, p: Parameters, images: Mapping[str, Estimate]
) -> tuple[Acquisition, Parameters]:
    """The usable part of a pressure record; its model, sound speed and start.

    Args:
        images: what they told before; nothing else is asked of them then.
    """
    frame = typical_frame(scan)[facts.order]
    p = p.with_(model=acoustic_model(facts, frame))
    p = p.with_(sound_speed=nominal_speed(scan, p), impulse_response=_response(scan))
    p = p.with_(time_shift=_start_of(scan, facts, frame, p["sound_speed"])).with_(**images)
    require_units_alike(facts, p)
    require_body_speed(p)
    require_ellipse(p)
    require_body_inside(p, facts.arc.radius if facts.arc else None)
    record, assumed = preprocess_in_plane(scan, facts, frame, p)
    if images:
        return record, assumed
    arc, speed = record.facts.arc, p["sound_speed"]
    if arc is not None and not p.gives("region_radius"):
        require_scale(float(record.times[-1]) * speed, arc.radius, speed)
    told = tell_acoustics(record, assumed)
    if told["model"] != assumed["model"]:
        return preprocess_in_plane(scan, facts, frame, told)
    return record, told


def _start_of(scan: Scan, facts: Facts, frame: np.ndarray, speed: float) -> Estimate:
    """As the file says: of times that it has, or of samples from when the laser fires.

    Args:
        frame: typical.
        speed: known before images [length/time].
    """
    if "times" in scan.known:
        return Estimate(0.0, "as the file says", source=Source.FILE)
    known = frame[np.isfinite(frame).all(axis=1)]
    seen = None
    if facts.arc is not None and facts.times is not None and len(known):
        seen = start_by_laser(known, facts.times, facts.arc.radius / speed)
    return seen or Estimate(0.0, "as the file says", source=Source.NOMINAL)


def _response(scan: Scan) -> Estimate:
    if "impulse_response" in scan.known:
        return Estimate(True, scan.about.get(RESPONSE, "in the file"))
    return Estimate(False, "none in the file; --element-band takes that of a data sheet")


def _integrals(scan: Scan, facts: Facts, p: Parameters) -> tuple[Acquisition, Parameters]:
    """Circular integrals, as simulated: there is little to choose.

    Raises:
        ValueError: for choices that only pressure has.
    """
    for name in NO_SOUND:
        if p.given.get(name) is not None:
            raise ValueError(
                f"{option_of(name)} is of pressure records, and the data are integrals over "
                "circles: leave it out."
            )
    order = tuple(int(k) for k in facts.order)
    p = p.fixed(**NO_SOUND, order=order, impulse_response=False, left_out=())
    p = p.replaced(channels=Estimate(None, "all", LIKELY))
    every, nothing = np.ones(len(order), bool), np.zeros((len(order), 0))
    silence = RecordPower(nothing[0], nothing)
    return Acquisition(scan, facts, nothing, silence, every, -np.inf, 0.0, 0.0), p


def choices_in_space(scan: Scan, given: Mapping[str, Any]) -> Choices:
    """All choices for a scan in space; see `choosing.choose`."""
    for name in NOT_IN_SPACE:
        if given.get(name) is not None:
            raise ValueError(
                f"{option_of(name)}: the detectors lie in space, around a ball about "
                "their own centre; there is no choice."
            )
    record, p = _about_center(*preprocess_in_space(scan, Parameters(given, Units())))
    p = _sound_in_space(record, p)
    require_body_speed(p)
    require_body_inside(p, record.facts.radius)
    for stage in BALL:
        p = stage(record, p)
    return p.choices() if record.facts.times is None else tell_acoustics_in_space(record, p)


def _about_center(
    record: AcquisitionInSpace, p: Parameters
) -> tuple[AcquisitionInSpace, Parameters]:
    """Detectors about their own centre, or that of a body, which is the region's too.

    Raises:
        ValueError: for a body off the centre of elements that have a size.
    """
    facts = facts_around(record.scan, record.facts, p.given.get("body_center"))
    center = tuple(float(x) for x in np.asarray(facts.detectors.center))
    return record._replace(facts=facts), p.fixed(
        region_center=center, region_angle=0.0, region_size=None
    )


def _sound_in_space(record: AcquisitionInSpace, p: Parameters) -> Parameters:
    """The record is taken as it is."""
    if record.facts.times is None:
        return p.fixed(**NO_SOUND, impulse_response=False)
    as_it_is = "the record is taken as it is"
    unfiltered = p.given.get("band") == "none"
    start = Source.FILE if "times" in record.scan.known else Source.NOMINAL
    p = p.with_(
        model=Estimate(IN_SPACE, "detectors in space, around a volume"),
        sound_speed=nominal_speed(record.scan, p),
        time_shift=Estimate(0.0, "as the file says", source=start),
        dead_time=Estimate(0.0, as_it_is, LIKELY),
        band=Estimate(None, as_it_is, LIKELY),
        impulse_response=_response(record.scan),
    )
    return p.replaced(band=Estimate(None, "given")) if unfiltered else p
