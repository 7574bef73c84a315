"""Everything that decides an image, each with its reason; in a file, it gives the image again."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..geometry import (
    DetectorCurve,
    ImageGrid,
    TruncatedDisk,
    detector_curve,
    keep_detectors,
    truncated_disk,
)
from ..pressure import MODELS
from ..problem import enough_boundary
from ..reconstruction.inversion import require_inversion
from ..reconstruction.radon import LOW_PASSES
from ..units import Units

IN_SPACE = "in-space"  # the model of point-like detectors around a volume


class Choices(eqx.Module):
    """What was chosen, or given, for the reconstruction of a scan.

    Lengths are in the unit of the detectors' positions, times in that of the record; `rows` and
    `table` tell them in millimetres and microseconds where those units are known.

    Attributes:
        order: rows of the data, in order along the curve.
        left_out: those among them that are not used.
        model: acoustic model of a pressure record, "2d", "in-plane" or, of a volume, "in-space";
            "none" for circular or spherical integrals.
        sound_speed: c [length/time].
        dead_time: the start of the record is silenced [time].
        band: pass band (f_lo, f_hi), or None for no filter [cycles/time].
        impulse_response: whether the one in the file is divided out.
        region_center, region_radius, region_cut, region_angle: of `truncated_disk`, angle in
            degrees; a cut at or beyond the radius leaves the whole disk. Of a volume, with a centre
            in space, of `spherical.ball_part` [length].
        pixels, half_width: of `ImageGrid` or `VolumeGrid`, about the region's centre [length].
        first_radius, radial_step, n_radii: of the circular integrals [length].
        max_frequency: lambda_max [rad/length].
        alpha: of `reconstruct_direct`.
        low_pass: "none" or "cosine".
        inversion: "fbp" or "fourier".
        reasons: pairs of a name above and why it is as it is.
        units: of positions and record, for the words.
    """

    order: tuple[int, ...] = eqx.field(static=True)
    left_out: tuple[int, ...] = eqx.field(static=True)
    model: str = eqx.field(static=True)
    sound_speed: float
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
    units: Units = eqx.field(static=True, default=Units())

    def __check_init__(self) -> None:
        models = *MODELS, IN_SPACE, "none"
        if self.model not in models:
            raise ValueError(f"model is {self.model!r}, expected one of {', '.join(models)}.")
        if self.low_pass not in LOW_PASSES:
            raise ValueError(
                f"low_pass is {self.low_pass!r}, expected one of {', '.join(LOW_PASSES)}."
            )
        require_inversion(self.inversion)

    @property
    def channels(self) -> tuple[int, ...]:
        """Rows of the data that are used, in order along the curve."""
        return tuple(k for k in self.order if k not in self.left_out)

    @property
    def region(self) -> TruncatedDisk:
        """Where the image is wanted, with enough points on its boundary for max_frequency."""
        around = 2 * math.pi * self.region_radius  # no less than where the disk is cut
        n_boundary = max(2 * len(self.order), enough_boundary(around, self.max_frequency))
        return truncated_disk(
            self.region_radius,
            min(self.region_cut, self.region_radius),
            n_boundary,
            center=np.array(self.region_center),
            angle=math.radians(self.region_angle),
        )

    @property
    def grid(self) -> ImageGrid:
        return ImageGrid(self.pixels, self.half_width, np.array(self.region_center))

    @property
    def radii(self) -> Float[Array, " radii"]:
        return jax.device_put(self.first_radius + self.radial_step * np.arange(self.n_radii))

    def curve(self, points: Float[np.ndarray, "detectors 2"]) -> DetectorCurve:
        """The detectors that are used, of all of the scan in the order of its data."""
        whole = detector_curve(points[list(self.order)])
        if not self.left_out:
            return whole
        return keep_detectors(whole, ~np.isin(self.order, self.left_out))

    def rows(self) -> list[tuple[str, str, str]]:
        """What, how much, why."""
        reasons = dict(self.reasons)
        return [
            (name, value, reasons[name]) for name, value in self._shown().items() if name in reasons
        ]

    def table(self) -> str:
        """A line for each choice: what, how much, why."""
        rows = self.rows()
        widths = [max(len(row[i]) for row in rows) for i in range(2)]
        return "\n".join(
            f"{name:{widths[0]}}  {value:{widths[1]}}  {reason}".rstrip()
            for name, value, reason in rows
        )

    def _shown(self) -> dict[str, str]:
        units, radius = self.units, self.region_radius
        cut = self.region_cut < radius
        return {
            "channels": f"{len(self.channels)} of {len(self.order)}",
            "model": self.model,
            "sound_speed": units.of_speed(self.sound_speed),
            "impulse_response": "removed" if self.impulse_response else "kept",
            "dead_time": units.of_time(self.dead_time),
            "band": units.of_band(*self.band) if self.band else "none",
            "region_radius": units.of_length(radius),
            "region_cut": units.of_length(self.region_cut, scale=radius) if cut else "none",
            "region_angle": f"{round(self.region_angle, 1) + 0.0:g} degrees",
            "region_center": units.of_place(self.region_center, radius),
            "max_frequency": units.of_wave_number(self.max_frequency),
            "pixels": f"{self.pixels}",
            "half_width": units.of_length(self.half_width),
            "alpha": f"{self.alpha:.2g}",
            "low_pass": self.low_pass,
            "inversion": self.inversion,
            "length_unit": self.units.length or "unknown",
        }

    def settings(self) -> dict[str, Any]:
        """As plain numbers and text, for a file; `from_settings` gives them back."""
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
            values = {name: _KINDS[name](settings[name]) for name in names}
        except (TypeError, ValueError) as error:
            raise ValueError(f"the settings cannot be read ({error}).") from error
        return cls(**values)


def _pair(value: Any) -> tuple[float, float]:
    first, second = value
    return float(first), float(second)


_KINDS: dict[str, Any] = {
    **dict.fromkeys(("model", "low_pass", "inversion"), str),
    **dict.fromkeys(("pixels", "n_radii"), int),
    **dict.fromkeys(
        ("sound_speed", "dead_time", "region_radius", "region_cut", "region_angle", "half_width"),
        float,
    ),
    **dict.fromkeys(("first_radius", "radial_step", "max_frequency", "alpha"), float),
    **dict.fromkeys(("order", "left_out"), lambda value: tuple(int(k) for k in value)),
    "impulse_response": bool,
    "region_center": lambda value: tuple(float(x) for x in value),
    "band": lambda value: None if value is None else _pair(value),
    "reasons": lambda value: tuple((str(name), str(why)) for name, why in value),
    "units": lambda value: Units(*value),
}
