"""A body whose speed of sound differs from that of the water around it."""

from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..base.checks import Numbers, by_library, is_concrete, real_array, require_positive
from ..base.hashable_methods import ComparedByIdentity
from ..special import root
from .curves import DetectorCurve
from .regions import Disk, Region, disk

SPEEDS = 0.7, 1.4  # of the body over the water: no tissue is farther from water
BEYOND = 1.25  # of the body's radius, up to which its waves may be continued outside


class DiskBody(ComparedByIdentity, eqx.Module):
    """|x - c| < a with the speed of sound c_1, in water of c_2: the medium of a `Setup`.

    All numbers are traced. The speeds count by their ratio alone, except where times are given.

    Attributes:
        center: c, (2,) [length].
        radius: a [length].
        sound_speed: c_1, in the body [length/time].
        water_speed: c_2, around it [length/time].
        density_ratio: rho_1/rho_2, of body and water.
    """

    center: Float[Array, "2"]
    radius: Float[Array, ""]
    sound_speed: Float[Array, ""]
    water_speed: Float[Array, ""]
    density_ratio: Float[Array, ""]

    def __init__(
        self,
        center: Numbers,
        radius: Numbers,
        sound_speed: Numbers,
        water_speed: Numbers,
        density_ratio: Numbers = 1.0,
    ):
        """A body that is a disk.

        Args:
            center: c, (2,) [length].
            radius: a > 0 [length].
            sound_speed: c_1 > 0, in the body, 0.7 to 1.4 of the water's [length/time].
            water_speed: c_2 > 0 [length/time].
            density_ratio: rho_1/rho_2 > 0.

        Raises:
            ValueError: for NaN, wrong shapes, what is not above zero, and speeds that are too far
                from each other.

        >>> body = DiskBody((0.1, 0.0), 0.45, 1540.0, 1500.0)
        >>> round(float(body.speed_ratio), 4)
        1.0267
        """
        self.center = real_array("center", center, (2,))
        numbers = {
            "radius": radius,
            "sound_speed": sound_speed,
            "water_speed": water_speed,
            "density_ratio": density_ratio,
        }
        for name, number in numbers.items():
            value = real_array(name, number, ())
            require_positive(name, value)
            setattr(self, name, value)
        _require_similar(self.sound_speed, self.water_speed)

    @property
    def speed_ratio(self) -> Float[Array, ""]:
        """c_1/c_2; waves of k in the body have the number k c_1/c_2 in water."""
        return self.sound_speed / self.water_speed

    @property
    def source_strength(self) -> Float[Array, ""]:
        """rho_2 c_2² / (rho_1 c_1²), the pressure of a source in the body over that in water."""
        return 1 / (self.speed_ratio**2 * self.density_ratio)


def _require_similar(body: Array, water: Array) -> None:
    if not is_concrete(body, water):
        return
    least, most = SPEEDS
    ratio = float(np.asarray(body)) / float(np.asarray(water))
    if not least <= ratio <= most:
        raise ValueError(
            f"sound_speed is {float(body):.6g} and water_speed {float(water):.6g}, a ratio of "
            f"{ratio:.3g}, expected {least} to {most}: give both in the same unit."
        )


def region_about(body: DiskBody, region: Region) -> Disk:
    """The least disk about the body's centre that holds the region.

    Its radius has a kink where both have one centre; the derivative there is the mean, 0.
    """
    size = region.radius if isinstance(region, Disk) and region.whole else None
    where = region.points if size is None else region.center[None]
    reach = by_library(_farthest, (where, body.center, 0.0 if size is None else size))
    return disk(reach, center=body.center, n_boundary=region.n_boundary)


def _farthest(xp: Any, points: Any, center: Any, more: Any) -> Any:
    return root(xp.sum((points - center) ** 2, axis=1).max(), xp) + more


def require_surrounded(curve: DetectorCurve, region: Region, body: DiskBody) -> None:
    """Raise ValueError where body, region and detectors do not go together; nothing if traced.

    Outside of the body its own waves are continued. Sources there are taken too early or too late
    by their distance from it times 1/c_1 - 1/c_2, which is worth while for a rim alone.
    """
    if not is_concrete(curve, region, body):
        return
    radius, center = float(body.radius), np.asarray(body.center)
    nearest = float(np.linalg.norm(np.asarray(curve.points) - center, axis=1).min())
    if radius >= nearest:
        raise ValueError(
            f"the body reaches {radius:.6g} from {center}, and a detector is {nearest:.6g} from "
            "there, expected detectors in the water: make its radius smaller, or check that both "
            "use the same unit of length."
        )
    reach = float(region_about(body, region).radius)
    if reach > BEYOND * radius * (1 + 1e-9):
        raise ValueError(
            f"the region reaches {reach:.6g} from the centre of the body, whose radius is "
            f"{radius:.6g}, expected sources in the body, at most {BEYOND} times that: make the "
            "region smaller, or the body larger."
        )


def lag(
    body: DiskBody, detectors: Float[Array, "detectors 2"], points: Float[Array, "n 2"]
) -> Float[Array, "detectors n"]:
    """L (c_2/c_1 - 1), L the part of the straight way from a detector to a point in the body."""
    where = detectors, points, body.center, body.radius, body.speed_ratio
    return by_library(_lag, where)


def _lag(xp: Any, detectors: Any, points: Any, center: Any, radius: Any, ratio: Any) -> Any:
    way = points - detectors[:, None]
    length = xp.linalg.norm(way, axis=-1)
    along = xp.sum(way * (center - detectors[:, None]), axis=-1) / length
    square = along**2 - xp.sum((center - detectors) ** 2, axis=-1)[:, None] + radius**2
    half = root(square, xp)
    inside = xp.clip(along + half, 0.0, length) - xp.clip(along - half, 0.0, length)
    return inside * (1 / ratio - 1)
