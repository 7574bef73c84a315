"""A body of another speed of sound than the water around it: a disk, any outline, or a ball."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..base.checks import Numbers, by_library, is_concrete, real_array, require_positive
from ..base.hashable_methods import ComparedByIdentity
from ..special import OutlineNodes, outline_sizes, root
from .balls import Ball
from .caps import DetectorPoints, Detectors
from .curves import DetectorCurve
from .regions import Disk, Region, disk

SPEEDS = 0.7, 1.4  # of the body over the water: no tissue is farther from water
FEWEST, ELLIPSE = 8, 16  # points of an outline, and of an ellipse, whose degree is 1
DENSE = 360  # points of an outline, for sizes and checks
BEYOND = 1.25  # of the body's radius, up to which its waves may be continued outside
GROWN, GROWN_ROUND = 2.0, 5.0  # logarithm of what its waves may have grown by there; of a circle
NEARLY_NONE = 1e-8  # of |s|², below which its functions are their series
SAME = 1e-9  # of a radius: centres that are no farther apart are one


class Body(ComparedByIdentity, eqx.Module):
    """What all bodies have: the medium of a `Setup`.

    All numbers are traced. The speeds count by their ratio alone, except where times are given.

    Attributes:
        center: about which its waves are taken, (2,), in space (3,) [length].
        radius: how far it reaches from there [length].
        sound_speed: c_1, in the body [length/time].
        water_speed: c_2, around it [length/time].
        density_ratio: rho_1/rho_2, of body and water.
    """

    center: eqx.AbstractVar[Float[Array, " dimension"]]
    radius: eqx.AbstractVar[Float[Array, ""]]
    sound_speed: eqx.AbstractVar[Float[Array, ""]]
    water_speed: eqx.AbstractVar[Float[Array, ""]]
    density_ratio: eqx.AbstractVar[Float[Array, ""]]

    @property
    def speed_ratio(self) -> Float[Array, ""]:
        """c_1/c_2; waves of k in the body have the number k c_1/c_2 in water."""
        return self.sound_speed / self.water_speed

    @property
    def source_strength(self) -> Float[Array, ""]:
        """rho_2 c_2² / (rho_1 c_1²), the pressure of a source in the body over that in water."""
        return 1 / (self.speed_ratio**2 * self.density_ratio)

    @property
    def equal_radius(self) -> Float[Array, ""]:
        """Of a disk of the same area [length]."""
        return self.radius

    def relative_radius(self, points: Float[Array, "*n space"]) -> Float[Array, "*n"]:
        """Distances from the centre over that of the rim in their direction."""
        return jnp.linalg.norm(points - self.center, axis=-1) / self.radius

    def may_sound(
        self, points: Float[Array, "*n space"], highest: Float[Array, ""]
    ) -> Bool[Array, "*n"]:
        """Whether points are in the body, or so near it that its waves have not grown much there.

        An image is made of waves of the body's speed, also beyond its rim. In a body that is faster
        than the water some of the finest nearly vanish inside, and outside grow exponentially with
        the distance d from the rim, by exp(√(k_2² - k_1²) d) at most, k_1 and k_2 = k_1 c_1/c_2
        their numbers in body and water. Faint sources there would explain whole records. Points
        count where that is less than e²; of a slower body all do. A disk or ball often stands for
        a body of another shape, which reaches beyond its rim: up to e⁵ there.

        Args:
            points: anywhere [length].
            highest: k_1 of the finest waves of an image [rad/length].
        """
        sizes = jnp.maximum(self.relative_radius(points), 1.0)
        beyond = jnp.linalg.norm(points - self.center, axis=-1) * (1 - 1 / sizes)
        rate = highest * jnp.sqrt(jnp.maximum(self.speed_ratio**2 - 1, 0.0))
        return beyond * rate <= self._grown

    @property
    def _grown(self) -> float:
        return GROWN_ROUND


def radial_step(spacing: Any, medium: Body | None) -> Any:
    """Distance of radii for pixels so far apart [length]: waves are shorter in slower water."""
    return spacing if medium is None else spacing * jnp.minimum(1 / medium.speed_ratio, 1.0)


class DiskBody(Body):
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
        radius = real_array("radius", radius, ())
        require_positive("radius", radius)
        self.radius = radius
        speeds = _speeds(sound_speed, water_speed, density_ratio)
        self.sound_speed, self.water_speed, self.density_ratio = speeds


class BallBody(Body):
    """A `DiskBody` in space: |x - c| < a with the speed of sound c_1, in water of c_2.

    Attributes:
        center: c, (3,) [length].
        radius, sound_speed, water_speed, density_ratio: a, c_1, c_2, rho_1/rho_2, as of a disk.
    """

    center: Float[Array, "3"]
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
        """A body that is a ball.

        Args:
            center: c, (3,) [length].
            radius, sound_speed, water_speed, density_ratio: as of a `DiskBody`.

        Raises:
            ValueError: as `DiskBody`.

        >>> body = BallBody((0.0, 0.0, 0.1), 0.45, 1540.0, 1500.0)
        >>> round(float(body.source_strength), 4)
        0.9487
        """
        self.center = real_array("center", center, (3,))
        disk = DiskBody((0.0, 0.0), radius, sound_speed, water_speed, density_ratio)
        self.radius, self.density_ratio = disk.radius, disk.density_ratio
        self.sound_speed, self.water_speed = disk.sound_speed, disk.water_speed

    @property
    def meridian(self) -> DiskBody:
        """The section with a plane through its centre, counted from there."""
        speeds = self.sound_speed, self.water_speed
        return DiskBody((0.0, 0.0), self.radius, *speeds, self.density_ratio)


def body_about(center: Any, radius: Any, sound_speed: Any, water_speed: Any) -> DiskBody | BallBody:
    """A `DiskBody` about a centre of two coordinates, a `BallBody` about one of three."""
    make = DiskBody if len(center) == 2 else BallBody
    return make(center, radius, sound_speed, water_speed)


def around_body(detectors: Detectors, body: BallBody | None) -> Detectors:
    """The same detectors with the centre of a body, about which its waves are.

    Rings about another centre, or one that is traced, are taken for scattered points.

    Raises:
        ValueError: for elements of a size that would face another centre than before.
    """
    if body is None:
        return detectors
    if is_concrete(detectors.center, detectors.distance, body.center):
        off = np.abs(np.asarray(detectors.center) - np.asarray(body.center)).max()
        if off <= SAME * float(np.asarray(detectors.distance).max()):
            return detectors
    if detectors.element_radius is not None:
        raise ValueError(
            "elements have a size and face another centre than that of the body, or a traced one: "
            "give both the same concrete center, or leave out element_radius."
        )
    weights = detectors.weights.reshape(-1)
    return DetectorPoints(detectors.points.reshape(-1, 3), weights, body.center)


class OutlineBody(Body):
    """A smooth closed outline with the speed of sound c_1 in it, in water of c_2.

    The outline is the trigonometric polynomial through its points, in equal steps of the parameter:
    x(t) = Σ_m a_m exp(i m t), x as a complex number. All numbers are traced.

    Attributes:
        points: of the outline, in their order, (points, 2) [length].
        sound_speed, water_speed: c_1 and c_2 [length/time].
        density_ratio: rho_1/rho_2, of body and water.
    """

    points: Float[Array, "points 2"]
    sound_speed: Float[Array, ""]
    water_speed: Float[Array, ""]
    density_ratio: Float[Array, ""]

    def __init__(
        self,
        points: Numbers,
        sound_speed: Numbers,
        water_speed: Numbers,
        density_ratio: Numbers = 1.0,
    ):
        """A body with any smooth outline.

        Args:
            points: on the outline, in their order, (points, 2) [length]; distances between
                neighbours may vary slowly. 16 to 64 are enough for smooth outlines.
            sound_speed: c_1 > 0, in the body, 0.7 to 1.4 of the water's [length/time].
            water_speed: c_2 > 0 [length/time].
            density_ratio: rho_1/rho_2 > 0.

        Raises:
            ValueError: for fewer than 8 points, NaN, an outline that crosses itself or is not seen
                whole from the mean of its points, and numbers as of `DiskBody`.

        >>> angles = np.arange(16) * np.pi / 8
        >>> body = OutlineBody(np.stack([np.cos(angles), np.sin(angles)], axis=1), 1.04, 1.0)
        >>> round(float(body.radius), 12), round(float(body.equal_radius), 12)
        (1.0, 1.0)
        """
        self.points = real_array("points", points, ("points", 2))
        if self.points.shape[0] < FEWEST:
            raise ValueError(
                f"the outline has {self.points.shape[0]} points, expected at least {FEWEST}."
            )
        speeds = _speeds(sound_speed, water_speed, density_ratio)
        self.sound_speed, self.water_speed, self.density_ratio = speeds
        _require_simple(self)

    @classmethod
    def ellipse(
        cls,
        center: Numbers,
        half_axes: Numbers,
        sound_speed: Numbers,
        water_speed: Numbers,
        density_ratio: Numbers = 1.0,
        *,
        angle: Numbers = 0.0,
    ) -> "OutlineBody":
        """A body that is an ellipse.

        Args:
            center: (2,) [length].
            half_axes: a, b > 0, (2,) [length].
            sound_speed, water_speed, density_ratio: as of any outline.
            angle: from the first axis to that of a [rad].

        >>> body = OutlineBody.ellipse((0.1, 0.0), (0.5, 0.4), 1540.0, 1500.0)
        >>> round(float(body.radius), 9), bool(np.allclose(body.center, [0.1, 0.0]))
        (0.5, True)
        """
        middle, axes = real_array("center", center, (2,)), real_array("half_axes", half_axes, (2,))
        turn = real_array("angle", angle, ())
        require_positive("half_axes", axes)
        points = _turned(jnp, axes * _on_circle(), turn)
        return cls(middle + points, sound_speed, water_speed, density_ratio)

    @classmethod
    def stretched_disk(
        cls,
        center: Numbers,
        radius: Numbers,
        stretch: Numbers,
        sound_speed: Numbers,
        water_speed: Numbers,
    ) -> "OutlineBody":
        """The ellipse c + a exp(S) u, |u| = 1, S = [[s_1, s_2], [s_2, -s_1]], for searches.

        Half axes are a exp(±|s|), the longer one at half of the angle of s. Where s is 0 this is a
        circle, with derivatives in s, which axes and angle of an ellipse have not.

        Args:
            center: c, (2,) [length].
            radius: a > 0, of the circle of the same area [length].
            stretch: s, (2,).
            sound_speed, water_speed: as of any outline.

        >>> body = OutlineBody.stretched_disk((0.1, 0.0), 0.4, (0.0, 0.2), 1540.0, 1500.0)
        >>> round(float(body.radius / body.equal_radius), 6), round(float(np.exp(0.2)), 6)
        (1.221403, 1.221403)
        """
        middle, s = real_array("center", center, (2,)), real_array("stretch", stretch, (2,))
        size = real_array("radius", radius, ())
        require_positive("radius", size)
        points = middle + size * by_library(_stretched, (_on_circle(), s))
        return cls(points, sound_speed, water_speed)

    @property  # of arrays, as the disk's field is
    def center(  # pyright: ignore[reportIncompatibleVariableOverride]
        self,
    ) -> Float[Array, "2"]:
        """The mean of its points [length]."""
        return by_library(lambda xp, points: xp.mean(points, axis=0), (self.points,))

    @property
    def radius(  # pyright: ignore[reportIncompatibleVariableOverride]
        self,
    ) -> Float[Array, ""]:
        """The largest distance from the centre [length]."""
        return by_library(_reach_of_outline, (self.points, self.center))

    @property
    def equal_radius(self) -> Float[Array, ""]:
        """Of a disk of the same area [length]."""
        return by_library(_equal_radius, (self.points,))

    @property
    def _grown(self) -> float:
        return GROWN

    def relative_radius(self, points: Float[Array, "*n space"]) -> Float[Array, "*n"]:
        """Distances from the centre over that of the outline in their direction."""
        rim, local = outline_at(jnp, self.points, DENSE)[0] - self.center, points - self.center
        angles, at = (jnp.arctan2(x[..., 1], x[..., 0]) for x in (rim, local))
        reach = jnp.interp(at, angles, jnp.linalg.norm(rim, axis=1), period=2 * np.pi)
        return jnp.linalg.norm(local, axis=-1) / reach

    def nodes(self, n_max: int, axis: Numbers = 0.0) -> OutlineNodes:
        """The outline about its centre, as waves up to an order need it.

        Args:
            n_max: highest order.
            axis: which becomes the first axis [rad].
        """
        n_nodes, n_tests = outline_sizes(n_max)
        turned = _turned(jnp, self.points - self.center, -jnp.asarray(axis))
        points, slopes = outline_at(jnp, turned, max(n_nodes, 4 * turned.shape[0]))
        length = jnp.sqrt(jnp.sum(slopes**2, axis=1))
        # whichever way around the points go
        area = jnp.sum(points[:, 0] * slopes[:, 1] - points[:, 1] * slopes[:, 0])
        normals = jnp.stack([slopes[:, 1], -slopes[:, 0]], axis=1) / length[:, None]
        return OutlineNodes(
            points=points,
            normals=jnp.sign(area) * normals,
            weights=2 * np.pi / points.shape[0] * length,
            tests=outline_at(jnp, turned, n_tests)[0],
        )


def _on_circle() -> Float[np.ndarray, "points 2"]:
    t = 2 * np.pi / ELLIPSE * np.arange(ELLIPSE)
    return np.stack([np.cos(t), np.sin(t)], axis=1)


def _stretched(xp: Any, points: Any, s: Any) -> Any:
    """exp(S) x = cosh|s| x + sinh|s| / |s| S x, smooth where s is 0."""
    square = s[0] ** 2 + s[1] ** 2
    far = square > NEARLY_NONE
    size = xp.sqrt(xp.where(far, square, 1.0))
    even = xp.where(far, xp.cosh(size), 1 + square / 2)
    odd = xp.where(far, xp.sinh(size) / size, 1 + square / 6)
    x, y = points[..., 0], points[..., 1]
    turned = xp.stack([s[0] * x + s[1] * y, s[1] * x - s[0] * y], axis=-1)
    return even * points + odd * turned


def outline_at(xp: Any, points: Any, n: int) -> tuple[Any, Any]:
    """The trigonometric polynomial through points, and its slope, at n equal steps."""
    given, degree = points.shape[0], (points.shape[0] - 1) // 2
    m, old = np.arange(-degree, degree + 1), 2 * np.pi / given * np.arange(given)
    # of an even number of points without the highest wave, of which there is one half
    to_waves = np.exp(-1j * m[:, None] * old) / given
    waves = np.exp(2j * np.pi / n * np.arange(n)[:, None] * m)
    return xp.asarray((waves @ to_waves).real) @ points, xp.asarray(
        (waves @ (1j * m[:, None] * to_waves)).real
    ) @ points


def _turned(xp: Any, points: Any, angle: Any) -> Any:
    cosine, sine = xp.cos(angle), xp.sin(angle)
    x, y = points[:, 0], points[:, 1]
    return xp.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)


def _reach_of_outline(xp: Any, points: Any, center: Any) -> Any:
    fine = outline_at(xp, points, DENSE)[0]
    return root(xp.sum((fine - center) ** 2, axis=1).max(), xp)


def _equal_radius(xp: Any, points: Any) -> Any:
    fine, slopes = outline_at(xp, points, DENSE)
    area = xp.sum(fine[:, 0] * slopes[:, 1] - fine[:, 1] * slopes[:, 0]) * np.pi / DENSE
    return root(xp.abs(area) / np.pi, xp)


def _require_simple(body: OutlineBody) -> None:
    """Raise ValueError unless the outline is seen whole from its centre; nothing if traced."""
    if not is_concrete(body.points):
        return
    fine = outline_at(np, np.asarray(body.points), DENSE)[0] - np.asarray(body.center)
    after = np.roll(fine, -1, axis=0)
    across = fine[:, 0] * after[:, 1] - fine[:, 1] * after[:, 0]
    turns = np.arctan2(across, np.sum(fine * after, axis=1))
    if np.abs(np.abs(turns.sum()) - 2 * np.pi) > 1e-6 or not (turns > 0).all() | (turns < 0).all():
        raise ValueError(
            "the outline crosses itself, or is not seen whole from the mean of its points, "
            f"{np.asarray(body.center)}: pass points in their order around the body, evenly "
            "spread, and smoothed where they wiggle."
        )


def _speeds(
    sound_speed: Numbers, water_speed: Numbers, density_ratio: Numbers
) -> tuple[Array, Array, Array]:
    numbers = {
        "sound_speed": sound_speed,
        "water_speed": water_speed,
        "density_ratio": density_ratio,
    }
    values = {name: real_array(name, number, ()) for name, number in numbers.items()}
    for name, value in values.items():
        require_positive(name, value)
    _require_similar(values["sound_speed"], values["water_speed"])
    return values["sound_speed"], values["water_speed"], values["density_ratio"]


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


def region_about(body: Body, region: Region) -> Disk:
    """The least disk about the body's centre that holds the region, and a body with an outline.

    The waves of an outline are found there. Its radius has a kink where both have one centre; the
    derivative there is the mean, 0.
    """
    reach = by_library(_farthest, _where(body, region))
    if isinstance(body, OutlineBody):
        reach = by_library(lambda xp, *reaches: xp.maximum(*reaches), (reach, body.radius))
    return disk(reach, center=body.center, n_boundary=region.n_boundary)


def _where(body: Body, region: Region | Ball) -> tuple[Any, Any, Any]:
    """Points of a region, the body's centre, and how far the region reaches from the points."""
    if isinstance(region, Ball) or (isinstance(region, Disk) and region.whole):
        return region.center[None], body.center, region.radius
    return region.points, body.center, 0.0


def _farthest(xp: Any, points: Any, center: Any, more: Any) -> Any:
    return root(xp.sum((points - center) ** 2, axis=1).max(), xp) + more


def require_surrounded(curve: DetectorCurve | Detectors, region: Region | Ball, body: Body) -> None:
    """Raise ValueError where body, region and detectors do not go together; nothing if traced.

    Outside of the body its own waves are continued. Sources there are taken too early or too late
    by their distance from it times 1/c_1 - 1/c_2, which is worth while for a rim alone.
    """
    if not is_concrete(curve, region, body):
        return
    radius, center = float(body.radius), np.asarray(body.center)
    nearest = float(np.linalg.norm(np.asarray(curve.points) - center, axis=-1).min())
    if radius >= nearest:
        raise ValueError(
            f"the body has the radius {radius:.6g}, and a detector is {nearest:.6g} from its "
            "centre, expected detectors in the water: make its radius smaller, or check that both "
            "use the same unit of length."
        )
    reach = float(by_library(_farthest, _where(body, region)))
    if reach > BEYOND * radius * (1 + 1e-9):
        raise ValueError(
            f"the region reaches {reach:.6g} from the centre of the body, whose radius is "
            f"{radius:.6g}, expected sources in the body, at most {BEYOND} times that: make the "
            "region smaller, or the body larger."
        )


def lag(
    body: Body, detectors: Float[Array, "detectors 2"], points: Float[Array, "n 2"]
) -> Float[Array, "detectors n"]:
    """L (c_2/c_1 - 1), L the part of the straight way from a detector to a point in the body.

    Of an outline that in the disk of its area.
    """
    where = detectors, points, body.center, body.equal_radius, body.speed_ratio
    return by_library(_lag, where)


def _lag(xp: Any, detectors: Any, points: Any, center: Any, radius: Any, ratio: Any) -> Any:
    way = points - detectors[:, None]
    length = xp.linalg.norm(way, axis=-1)
    along = xp.sum(way * (center - detectors[:, None]), axis=-1) / length
    square = along**2 - xp.sum((center - detectors) ** 2, axis=-1)[:, None] + radius**2
    half = root(square, xp)
    inside = xp.clip(along + half, 0.0, length) - xp.clip(along - half, 0.0, length)
    return inside * (1 / ratio - 1)
