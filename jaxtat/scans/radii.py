"""Radii of the integrals: those given or of the file, or all that the record covers.

Sources outside the region are recorded too. Their circles must not be cut, which would falsify the
image inside.
"""

from typing import Any

import jax
import numpy as np

from ..geometry import ball, data_radii, disk, radial_step, uncovered
from ..records import supported
from ..spherical import cap_radii
from .choices import body_of
from .estimate import Estimate
from .medium import path_speed
from .parameters import Parameters
from .preprocess import RIM, Acquisition, AcquisitionInSpace, known_radii
from .region import circle_without_detectors
from .resolution import (
    PIXELS,
    SAMPLED,
    SPACING,
    expecting,
    least,
    require_record,
    where_of,
)


def radii_in_plane(record: Acquisition, p: Parameters) -> Parameters:
    """Of a pressure record in the plane."""
    if p.gives("radii"):
        return _with_radii(p, np.asarray(p.given["radii"]))
    spacing = 2 * float(p["half_width"]) / (int(p["pixels"]) - 1)
    step = float(radial_step(spacing, body_of(p.values)))
    arc = record.facts.arc or circle_without_detectors(record.points, p["region_center"])
    end = float(record.times[-1]) * path_speed(p)
    # the last radius may lie a step beyond the farthest source
    reach = min(RIM * arc.radius, end - step - arc.radius)
    sources = disk(reach, center=np.array(arc.center)) if reach > 0 else None
    every = np.asarray(data_radii(*where_of(record, p), step, sources=sources))
    return _with_radii(p, every[every <= end])


def radii_of_integrals(record: Acquisition, p: Parameters) -> Parameters:
    """Radii of the file, or those that go with pixels; pixels that go with them."""
    half_width, where = float(p["half_width"]), where_of(record, p)
    own = known_radii(record.scan, p)
    pixels, why = 129, "as many as the paper's"
    if own is not None:
        step = float(np.diff(own).mean())
        pixels, why = round(2 * half_width / step) + 1, "as far apart as the radii"
    p = p.with_(pixels=Estimate(int(np.clip(pixels, *PIXELS)), why))
    step = 2 * half_width / (max(int(p["pixels"]), 2) - 1)
    if own is not None:
        p = expecting(p, uncovered(*where, jax.device_put(own)))
    every = np.asarray(data_radii(*where, step)) if own is None else own
    support = supported(*where, np.arange(8.0))  # times are not asked for
    of_step = np.pi / max(step, float(np.diff(every).max()))
    of_detectors = float(support.frequency_of_detectors) / SAMPLED
    limits = Estimate(of_step, "pixel and radial step"), Estimate(of_detectors, SPACING)
    return _with_radii(p.with_(max_frequency=least(*limits)), every)


def radii_in_space(record: AcquisitionInSpace, p: Parameters) -> Parameters:
    """Radii of the file, or all that the record covers, half a voxel apart."""
    facts, radius, cut = record.facts, p["region_radius"], p["region_cut"]
    own = known_radii(record.scan, p)
    region = ball(radius, cut if cut < radius else None, center=facts.detectors.center)
    meridian = facts.detectors.meridian, region.meridian
    end = np.inf
    if facts.times is not None:
        support = supported(*meridian, facts.times, sound_speed=path_speed(p))
        require_record(support, path_speed(p), np.inf)
        end = float(facts.times[-1]) * path_speed(p)
    if own is not None:
        return _with_radii(expecting(p, uncovered(*meridian, jax.device_put(own))), own)
    half_voxel = float(p["half_width"]) / (int(p["pixels"]) - 1)
    step = float(radial_step(half_voxel, body_of(p.values)))
    reach = min(RIM * facts.radius, end - step - facts.radius)
    sources = ball(reach, center=region.center) if reach > 0 else None
    every = np.asarray(cap_radii(facts.detectors, region, step, sources=sources))
    return _with_radii(p, every[every <= end])


def _with_radii(p: Parameters, every: Any) -> Parameters:
    """Equispaced radii of the integrals, (radii,) [length]."""
    if len(every) < 2:
        raise ValueError(
            "radii would be as far apart as pixels, and the data do not cover two of them: "
            "take more pixels, or a smaller half_width."
        )
    step = float(every[1] - every[0])
    return p.fixed(first_radius=float(every[0]), radial_step=step, n_radii=len(every))
