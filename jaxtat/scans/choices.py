"""Everything that decides an image, each with its reason; in a file, it gives the image again."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..base.choice_table import CHOICES, GRADES, GUESSED
from ..base.option_values import PENALTIES
from ..base.units import Units
from ..geometry import (
    Body,
    DetectorCurve,
    ImageGrid,
    OutlineBody,
    Region,
    VolumeGrid,
    body_about,
    detector_curve,
    disk,
    keep_detectors,
    rectangle,
)
from ..geometry.balls import Ball, ball
from ..records import MODELS
from ..steps.inversion import require_inversion
from ..steps.radon import LOW_PASSES

IN_SPACE = "in-space"  # the model of point-like detectors around a volume


def plane_region(values: Mapping[str, Any]) -> Region:
    """The region of interest of choices by name, a disk or a rectangle."""
    center = jax.device_put(np.array(values["region_center"]))
    if values["region_size"] is not None:
        return rectangle(np.array(values["region_size"]) / 2, center=center)
    radius, cut = values["region_radius"], values["region_cut"]
    angle = math.radians(values["region_angle"])
    return disk(radius, cut if cut < radius else None, center=center, angle=angle)


def body_of(values: Mapping[str, Any]) -> Body | None:
    """The body of choices by name; None for one speed of sound."""
    if values["water_speed"] is None:
        return None
    center, radius, *speeds = (
        values[name] for name in ("body_center", "body_radius", "sound_speed", "water_speed")
    )
    if values["body_axes"] is None:
        return body_about(center, radius, *speeds)
    angle = math.radians(values["body_angle"])
    return OutlineBody.ellipse(center, np.array(values["body_axes"]), *speeds, angle=angle)


class Choices(eqx.Module):
    """Parameters of the reconstruction of a scan, chosen or given.

    Lengths are in the unit of the detectors' positions, times in that of the record; `rows` and
    `table` have them in millimetres and microseconds where those units are known.

    Attributes:
        order: rows of the data, in order along the curve.
        left_out: those among them that are not used.
        model: acoustic model of a pressure record, "2d", "in-plane" or, of a volume, "in-space";
            "none" for circular or spherical integrals.
        sound_speed: c, with a water speed that of the body [length/time].
        water_speed: around the body, where that is another one [length/time]; None for one speed.
        body_radius, body_center: of the disk, or ball, of the other speed [length]; None for one.
        body_axes, body_angle: half axes of a body that is an ellipse [length], whose radius is that
            of the circle of its area, and the direction of the first [degrees]; None of a disk.
        time_shift: what is added to the times of the file [time].
        dead_time: before it the record is silenced [time].
        band: pass band (f_lo, f_hi), or None for no filter [cycles/time].
        impulse_response: whether the one in the file is divided out.
        laser_energy: whether frames are divided by the energy of their pulses.
        region_size: (width, height) of a rectangle about the centre, which is the region then, with
            its corners at the radius; None for a disk [length].
        region_center, region_radius, region_cut, region_angle: of `disk`, angle in degrees; a cut
            at or beyond the radius leaves the whole disk. Of a volume, with a centre in space, of
            `spherical.ball` [length].
        pixels, half_width: of `ImageGrid` or `VolumeGrid`, about the region's centre [length].
        first_radius, radial_step, n_radii: of the circular integrals [length].
        max_frequency: lambda_max [rad/length].
        alpha: a number as the rule of `solve`.
        low_pass: "none" or "cosine".
        inversion: "fourier" or "fbp".
        reasons: pairs of a name above and why it is as it is.
        grades: pairs of a name above and how far the choice can be trusted: "sure" is given, in
            the file, or follows from it, "likely" what the data show by a rule, "guessed" what
            nothing shows.
        standard_errors: pairs of a name above and the standard error of its number, where there is
            one [unit of the number].
        user_set: names of the options that were given, as in `choose`.
        units: of positions and record, for the words.
        model_based: whether images are fitted under constraints, see `constrained`.
        penalty, nonnegative, weight: of these.
    """

    order: tuple[int, ...] = eqx.field(static=True)
    left_out: tuple[int, ...] = eqx.field(static=True)
    model: str = eqx.field(static=True)
    sound_speed: float
    time_shift: float
    dead_time: float
    band: tuple[float, float] | None
    impulse_response: bool = eqx.field(static=True)
    region_center: tuple[float, ...]
    region_radius: float
    region_cut: float
    region_angle: float
    pixels: int = eqx.field(static=True)
    half_width: float
    first_radius: float
    radial_step: float
    n_radii: int = eqx.field(static=True)
    max_frequency: float
    alpha: float
    low_pass: str = eqx.field(static=True)
    inversion: str = eqx.field(static=True)
    reasons: tuple[tuple[str, str], ...] = eqx.field(static=True)
    grades: tuple[tuple[str, str], ...] = eqx.field(static=True, default=())
    standard_errors: tuple[tuple[str, float], ...] = eqx.field(static=True, default=())
    user_set: tuple[str, ...] = eqx.field(static=True, default=())
    units: Units = eqx.field(static=True, default=Units())
    region_size: tuple[float, float] | None = None
    laser_energy: bool = eqx.field(static=True, default=False)
    model_based: bool = eqx.field(static=True, default=False)
    penalty: str = eqx.field(static=True, default="tv")
    nonnegative: bool = eqx.field(static=True, default=False)
    weight: float | None = None
    water_speed: float | None = None
    body_radius: float | None = None
    body_center: tuple[float, ...] | None = None
    body_axes: tuple[float, float] | None = None
    body_angle: float | None = None

    def __check_init__(self) -> None:
        models = *MODELS, IN_SPACE, "none"
        if self.model not in models:
            raise ValueError(f"model is {self.model!r}, expected one of {', '.join(models)}.")
        if self.low_pass not in LOW_PASSES:
            raise ValueError(
                f"low_pass is {self.low_pass!r}, expected one of {', '.join(LOW_PASSES)}."
            )
        if self.penalty not in PENALTIES:
            raise ValueError(
                f"penalty is {self.penalty!r}, expected one of {', '.join(PENALTIES)}."
            )
        unknown = sorted({grade for _, grade in self.grades} - set(GRADES))
        if unknown:
            raise ValueError(f"grades are {unknown}, expected some of {', '.join(GRADES)}.")
        require_inversion(self.inversion)
        if (self.body_axes is None) != (self.body_angle is None):
            raise ValueError("body_axes and body_angle belong together: give both or none.")
        body = self.water_speed, self.body_radius, self.body_center
        if any(part is None for part in body) and any(part is not None for part in body):
            raise ValueError(
                "water_speed, body_radius and body_center belong together: give all or none."
            )

    @property
    def channels(self) -> tuple[int, ...]:
        """Rows of the data that are used, in order along the curve."""
        return tuple(k for k in self.order if k not in self.left_out)

    @property
    def in_space(self) -> bool:
        """Whether the detectors lie around a volume."""
        return len(self.region_center) == 3

    @property
    def region(self) -> Region | Ball:
        """The region of interest."""
        if self.in_space:
            cut = self.region_cut if self.region_cut < self.region_radius else None
            center = jax.device_put(np.array(self.region_center))
            return ball(self.region_radius, cut, center=center)
        return plane_region(self.settings())

    @property
    def path_speed(self) -> float:
        """c by which times are radii, the water's where there are two speeds [length/time]."""
        return self.sound_speed if self.water_speed is None else self.water_speed

    @property
    def medium(self) -> Body | None:
        """The body of another speed than the water's."""
        return body_of(self.settings())

    @property
    def grid(self) -> ImageGrid | VolumeGrid:
        make = VolumeGrid if self.in_space else ImageGrid
        return make(self.pixels, self.half_width, np.array(self.region_center))

    @property
    def radii(self) -> Float[Array, " radii"]:
        return jax.device_put(self.first_radius + self.radial_step * np.arange(self.n_radii))

    def curve(self, points: Float[np.ndarray, "detectors 2"]) -> DetectorCurve:
        """The detectors that are used, of all of the scan in the order of its data."""
        whole = detector_curve(points[list(self.order)])
        if not self.left_out:
            return whole
        return keep_detectors(whole, ~np.isin(self.order, self.left_out))

    def grade(self, name: str) -> str:
        """The grade of a choice; "guessed" if it has none."""
        return dict(self.grades).get(name, GUESSED)

    def with_reason(
        self, name: str, reason: str, grade: str, standard_error: float | None = None
    ) -> "Choices":
        """The same, with another reason and grade for one of them, which is estimated then."""
        errors = {**dict(self.standard_errors), name: standard_error}
        return dataclasses.replace(
            self,
            reasons=tuple({**dict(self.reasons), name: reason}.items()),
            grades=tuple({**dict(self.grades), name: grade}.items()),
            standard_errors=tuple((n, error) for n, error in errors.items() if error is not None),
        )

    def regularised_by_plan(self) -> "Choices":
        """The same where a plan's own rule decides: the table and the page show no alpha."""
        return dataclasses.replace(
            self, reasons=tuple((name, why) for name, why in self.reasons if name != "alpha")
        )

    def rows(self) -> list[tuple[str, str, str, str]]:
        """What, how much, how sure, why."""
        reasons = dict(self.reasons)
        shown = {"channels": f"{len(self.channels)} of {len(self.order)}"}
        shown |= {
            choice.name: choice.shown(self)
            for choice in CHOICES
            if choice.shown and choice.name in reasons
        }
        shown["length_unit"] = self.units.length or "unknown"
        return [
            (name, value, self.grade(name), reasons[name])
            for name, value in shown.items()
            if name in reasons
        ]

    def table(self) -> str:
        """A line for each choice: what, how much, how sure, why."""
        rows = self.rows()
        widths = [max(len(row[i]) for row in rows) for i in range(3)]
        return "\n".join(
            f"{name:{widths[0]}}  {value:{widths[1]}}  {grade:{widths[2]}}  {reason}".rstrip()
            for name, value, grade, reason in rows
        )

    def settings(self) -> dict[str, Any]:
        """The choices as plain numbers and text, for a file; `from_settings` reads them."""
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> "Choices":
        """Choices from what `settings` gave, also after a journey through JSON.

        Raises:
            ValueError: for settings that are not those of choices.
        """
        names = {field.name for field in dataclasses.fields(cls)}
        if set(settings) != names:
            raise ValueError(
                "the settings are not those of an automatic reconstruction: missing "
                f"{sorted(names - set(settings))}, unknown {sorted(set(settings) - names)}."
            )
        try:
            values: dict[str, Any] = {c.name: c.stored(settings[c.name]) for c in CHOICES}
            reasons = tuple((str(name), str(why)) for name, why in settings["reasons"])
            grades = tuple((str(name), str(grade)) for name, grade in settings["grades"])
            errors = tuple((str(n), float(error)) for n, error in settings["standard_errors"])
            values |= {"reasons": reasons, "grades": grades, "standard_errors": errors}
            values["user_set"] = tuple(map(str, settings["user_set"]))
            values["units"] = Units(*settings["units"])
        except (TypeError, ValueError) as error:
            raise ValueError(f"the settings cannot be read ({error}).") from error
        return cls(**values)


def at_speed(choices: Choices, stretch: float) -> Choices:
    """Choices at another speed of sound: radii for the same times, no farther apart than before.

    Where there are two, radii are those of the water's, and stay.

    Args:
        choices: of a pressure record.
        stretch: the other speed over that of the choices.
    """
    if choices.water_speed is not None:
        return dataclasses.replace(choices, sound_speed=choices.sound_speed * stretch)
    n_steps = choices.n_radii - 1
    n_more = max(n_steps, int(np.ceil(n_steps * stretch - 1e-9)))
    return dataclasses.replace(
        choices,
        sound_speed=choices.sound_speed * stretch,
        first_radius=choices.first_radius * stretch,
        radial_step=choices.radial_step * stretch * n_steps / n_more,
        n_radii=n_more + 1,
    )
