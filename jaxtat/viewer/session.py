"""The state of one page: a scan, the values of its controls, and the last results."""

import copy
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from ..base.choice_table import METHOD, OPTIONS, PLAIN, RECORD
from ..base.units import ROUNDING
from ..geometry import ImageGrid, fit_circle
from ..io import Scan
from ..scans import Choices, ImageErrors, choose, image_errors, integrals, with_best_method
from ..scans.acoustics import shares_by_speed
from ..scans.acquisition import FASTEST, SLOWEST, facts_of, nominal_water_speed, times_of
from ..scans.constrained import fitted
from ..scans.frames import per_energy
from ..steps import universal_back_projection
from ..streams import Live, live
from .image_methods import (
    BACK_PROJECTION,
    DIRECT,
    METHODS,
    MODEL_BASED,
    as_direct,
    as_fit,
    with_reasons,
)
from .viewed_scan import ViewedScan

SPEEDS = 25  # of the curve by which one is chosen
SHIFT, SAMPLES = 2.0, 80  # of a start to either side [us]; where no unit of time is known
PIXELS = 257  # of images, where nothing else is said
Shown = tuple[float, tuple[float, float]]  # radius and centre of a disk [length]
_KEPT = (PLAIN, RECORD, METHOD)  # groups of choices that another region leaves as they are


@dataclass(frozen=True)
class ControlValues:
    """Values of the controls.

    Attributes:
        sound_speed: c, of two that of the body [length/time]; of no meaning for circular integrals.
        alpha: Tikhonov's, as in `solve`.
        low_pass: "none" or "cosine".
        frame: of the scan, from 0.
        method: "direct", "back-projection" or "model-based", a fit.
        disk: radius and centre of a part of the region that is looked at, with as many pixels
            [length]; None for all of it, as always model-based.
        water_speed: around the body [length/time]; None for one speed.
        time_shift: what is added to the times of the file [time].
    """

    sound_speed: float
    alpha: float
    low_pass: str
    frame: int = 0
    method: str = DIRECT
    disk: Shown | None = None
    water_speed: float | None = None
    time_shift: float = 0.0

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ValueError(f"method is {self.method!r}, expected one of {', '.join(METHODS)}.")


class Session(ViewedScan):
    """Images of a scan for any values of the controls; only what a control changes is recomputed.

    Args:
        scan: in the plane; its frames may be lazy, and only those that are shown are read.
        choices: with which everything begins; those of a fit are of the model-based images.
        facts: what was said of the scan in options of the command, by their names.

    Attributes:
        scan, facts: those.
        choices: of the direct image, made with ``inversion="fourier"``.
        start: where the controls stand at first, with the method that is more accurate.

    Raises:
        ValueError: as `live`: for scans in space, and records that end too early for a formula.
    """

    def __init__(self, scan: Scan, choices: Choices, facts: Mapping[str, Any] | None = None):
        self._best = with_best_method(scan, choices)
        choices = as_direct(choices)
        if choices.inversion != "fourier":
            choices = replace(choices, inversion="fourier")
            choices = with_reasons(choices, {"inversion": "the viewer's"})
        super().__init__(scan, choices, facts)
        direct = ControlValues(
            choices.sound_speed,
            choices.alpha,
            choices.low_pass,
            water_speed=choices.water_speed,
            time_shift=choices.time_shift,
        )
        self._solved = live(scan, choices), direct  # one object: copies may be made meanwhile
        self.start = replace(direct, method=MODEL_BASED) if self._best.model_based else direct
        self._frame = 0, self._lit(0)
        grid = self._live.setup.grid
        self.inside = np.asarray(self._live.setup.region.contains(grid.points))

    @property
    def _live(self) -> Live:
        return self._solved[0]

    def copy(self) -> "Session":
        """A session for another page: changes in one are not seen in the other."""
        return copy.copy(self)

    def image(self, controls: ControlValues) -> Float[np.ndarray, "x1 x2"]:
        """The image, NaN outside of the region.

        Raises:
            ValueError: for a frame that cannot be read or holds NaN, and a speed of sound at which
                the record is too short.
        """
        made = {
            DIRECT: self._direct,
            BACK_PROJECTION: self._back_projected,
            MODEL_BASED: self._fitted,
        }[controls.method](controls)
        inside = self.inside
        if controls.method != MODEL_BASED and controls.disk is not None:
            inside = np.asarray(self._live.region.contains(self._live.setup.grid.points))
        return np.where(inside, np.asarray(made), np.nan)

    def errors(self, controls: ControlValues) -> ImageErrors:
        """How far the image of the whole region may be off; of a fit from eight more, in seconds.

        Raises:
            ValueError: as `image`, for back-projection, and where nothing tells of the noise.
        """
        controls = replace(controls, disk=None)
        choices = self.choices_of(controls)
        image = np.nan_to_num(self.image(controls))
        found = image_errors(self.scan, choices, controls.frame, image)
        if found is None:
            raise ValueError(
                "how far this image may be off is not known: no part of the record is quiet, by "
                "which its noise could be told."
            )
        return found

    def grid(self, controls: ControlValues) -> ImageGrid:
        """The nodes of an image."""
        self._recompute(controls)
        return self._live.setup.grid

    @property
    def can_look(self) -> bool:
        """Whether a part of the region can be shown alone, which needs a whole disk."""
        choices = self.choices
        return choices.region_size is None and choices.region_cut >= choices.region_radius

    def choices_of(self, controls: ControlValues) -> Choices:
        """All choices of an image, with reasons: `scans.reconstruct` makes the same of them.

        Raises:
            ValueError: for back-projection, which only the viewer has.
        """
        if controls.method == BACK_PROJECTION:
            raise ValueError(
                "back-projection is here for comparison, and no other command makes it, or knows "
                "its errors: keep the picture, or choose another method."
            )
        turned = self._choices_by_controls(controls)
        return as_fit(turned, self._best) if controls.method == MODEL_BASED else turned

    def speeds(self) -> tuple[float, float]:
        """Least and greatest speed of sound that is offered [length/time]."""
        nominal = nominal_water_speed(self.choices.units) or self.choices.sound_speed
        known = self.choices.sound_speed, self.choices.path_speed
        return min(SLOWEST * nominal, 0.97 * min(known)), max(FASTEST * nominal, 1.03 * max(known))

    def time_shifts(self) -> tuple[float, float]:
        """Least and greatest shift of the times that is offered [time]."""
        units, times, middle = self.choices.units, times_of(self.scan), self.choices.time_shift
        most = SHIFT / units.microseconds
        if times is not None and not units.time:
            most = SAMPLES * float(times[1] - times[0])
        return middle - most, middle + most

    def unexplained(
        self, controls: ControlValues
    ) -> tuple[Float[np.ndarray, " speeds"], Float[np.ndarray, " speeds"]] | None:
        """Speeds of sound, and what share of the record the best image leaves unexplained at each.

        None for circular integrals, two speeds, and for a record that is too short to tell.
        """
        if self.scan.kind != "pressure" or self.choices.water_speed is not None:
            return None
        low, high = self.speeds()
        speeds = np.linspace(low, high, SPEEDS)
        frame = np.asarray(self.scan.frame(controls.frame), float)
        choices = replace(self.choices, time_shift=controls.time_shift)
        shares = shares_by_speed(self.scan, choices, frame, speeds)
        return None if shares is None else (speeds, shares)

    def with_region(
        self, radius: float, center: tuple[float, float], controls: ControlValues
    ) -> "Session":
        """A session of another region, by its radius and centre [length].

        That is another problem, with programs of its own: it takes as long as the first one did.

        Raises:
            ValueError: for a region that does not fit the detectors or the record.
        """
        self._require_room(radius, center)
        kept = {c.name: getattr(self.choices, c.name) for c in OPTIONS if c.group in _KEPT}
        kept |= {"sound_speed": controls.sound_speed, "alpha": controls.alpha}
        kept |= {"low_pass": controls.low_pass, "water_speed": controls.water_speed}
        kept |= {"time_shift": controls.time_shift}
        kept |= {"pixels": self.choices.pixels}
        if self.scan.kind != "pressure":
            kept = {name: kept[name] for name in ("alpha", "low_pass", "max_frequency", "pixels")}
        else:
            kept["band"] = kept["band"] or "none"
        kept |= {"use": np.array(self.choices.channels), "inversion": "fourier"}
        with self._naming_unit():
            moved = choose(self.scan, **kept, region_radius=radius, region_center=center)
        before = dict(self.choices.reasons)
        for name in kept:
            if name in before:
                moved = moved.with_reason(name, before[name], self.choices.grade(name))
        start = self.choices
        moved = replace(moved, user_set=start.user_set)
        if self._best.model_based:
            moved = as_fit(moved, self._best)
        with self._naming_unit():
            return Session(self.scan, moved, self.facts)

    @contextmanager
    def _naming_unit(self) -> Iterator[None]:
        """Name the unit of lengths in errors of other packages; the page uses millimetres."""
        try:
            yield
        except ValueError as error:
            unit = self.choices.units.length
            raise ValueError(f"{error} (lengths in {unit})" if unit else str(error)) from error

    def _require_room(self, radius: float, center: tuple[float, float]) -> None:
        """Raise ValueError for a region at the detectors, in millimetres as the page has them."""
        units, points = self.choices.units, facts_of(self.scan).points
        apart = points[list(self.choices.channels)] - np.array(center)
        nearest = float(np.hypot(*apart.T).min())
        if not 0 < radius < nearest:
            raise ValueError(
                f"a region of radius {units.of_length(radius)} about "
                f"{units.of_place(center, radius)}: the nearest detector is "
                f"{units.of_length(nearest)} from there, expected a smaller radius."
            )

    def _read(self, frame: int) -> np.ndarray:
        if self._frame[0] != frame:
            self._frame = frame, self._lit(frame)
        return self._frame[1]

    def _lit(self, frame: int) -> np.ndarray:
        return per_energy(self.scan, self.choices, self.scan.frame(frame), frame)

    def _direct(self, controls: ControlValues) -> np.ndarray:
        self._recompute(controls)
        return np.asarray(self._live(self._read(controls.frame), energy=1.0))  # divided out before

    def _recompute(self, controls: ControlValues) -> None:
        """Recompute only what depends on controls that were changed."""
        before = self._solved[1]
        new, made = _settings(controls), _settings(before)
        turned: dict[str, Any] = {name: value for name, value in new.items() if value != made[name]}
        body, speeds = self._live.setup.medium, ("sound_speed", "water_speed")
        of_body = {name: getattr(controls, name) for name in speeds}
        if body is not None and of_body != {name: getattr(before, name) for name in speeds}:
            turned["medium"] = replace(body, **of_body)
        disk = None if controls.method == MODEL_BASED else controls.disk
        controls = replace(controls, disk=disk)
        if disk != before.disk:
            turned |= self._looked_at(disk)
        if turned:
            with self._naming_unit():
                self._solved = self._live.replace(**turned), controls

    def _looked_at(self, disk: Shown | None) -> dict[str, Any]:
        choices = self.choices
        radius, center = disk or (choices.region_radius, choices.region_center)
        off = math.dist(center, choices.region_center)
        if off + radius > choices.region_radius * (1 + ROUNDING):
            size, apart, whole = map(choices.units.of_length, (radius, off, choices.region_radius))
            raise ValueError(
                f"a disk of radius {size} that is {apart} off the middle leaves the region, whose "
                f"radius is {whole}: take it as the region."
            )
        return {"region_radius": radius, "region_center": center}

    def _choices_by_controls(self, controls: ControlValues) -> Choices:
        """The choices, with radii as they are at this speed."""
        self._recompute(controls)
        start, said = self.choices, {}
        for name in ("sound_speed", "water_speed", "time_shift", "alpha", "low_pass"):
            if getattr(controls, name) != getattr(start, name):
                said[name] = "set in the viewer"
        if self.scan.kind == "pressure":
            radii = np.asarray(self._live.radii)
            start = replace(
                start,
                sound_speed=controls.sound_speed,
                water_speed=controls.water_speed,
                time_shift=controls.time_shift,
                first_radius=float(radii[0]),
                radial_step=float(radii[-1] - radii[0]) / (len(radii) - 1),
            )
        return with_reasons(replace(start, alpha=controls.alpha, low_pass=controls.low_pass), said)

    def _back_projected(self, controls: ControlValues) -> Any:
        choices, setup = (
            self._choices_by_controls(controls),
            self._live.setup.replace(radii=self._live.radii),
        )
        if choices.band is not None:  # two derivatives: no more than the other images hold
            low, high = choices.band
            highest = choices.sound_speed * choices.max_frequency / (2 * np.pi)
            choices = replace(choices, band=(low, min(high, highest)))
        g = integrals(self.scan, choices, setup, self._read(controls.frame))
        middle = fit_circle(setup.curve.points).center
        return universal_back_projection(g, setup.radii, setup.curve, setup.grid, middle)

    def _fitted(self, controls: ControlValues) -> Any:
        choices, setup = self.choices_of(controls), self._live.setup.replace(radii=self._live.radii)
        return fitted(self.scan, choices, setup, self._read(controls.frame)).image


def _settings(controls: ControlValues) -> dict[str, Any]:
    """What images are recomputed by, by names of `Live.replace`."""
    speed = controls.sound_speed if controls.water_speed is None else controls.water_speed
    return {
        "sound_speed": speed,
        "time_shift": controls.time_shift,
        "rule": controls.alpha,
        "low_pass": controls.low_pass,
    }
