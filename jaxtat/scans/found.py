"""Choices while they are made: the common part for the plane and space."""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import jax
import numpy as np

from ..base.choice_table import GUESSED, LIKELY, OF_CONSTRAINTS, SURE
from ..base.units import Units
from ..geometry import require_radii
from ..io import Scan
from ..records import MODELS, Supported
from .acquisition import SLOWEST, nominal_water_speed
from .choices import Choices

DEFAULT_SHARE = 0.75  # of the detectors' radius, where the record does not show it
SHARES = (0.1, 0.9)  # least and largest region radius over the arc's
LONGEST = 100.0  # radii of the arc: no record of a scanner is that long
RIM = 0.95  # of the detectors' radius, up to which sources are reckoned with
ALPHAS = (1e-6, 1e-1)
CLEAN = 1e-5  # alpha below which no low-pass filter is needed
INTEGRALS_ALPHA = 1e-6
ADDS = "light that is absorbed only adds pressure; --signed allows f < 0"
OF_BODY = ("water_speed", "body_radius", "body_center")
OF_FORMULA = ("alpha", "low_pass", "inversion")  # choices that mean nothing to a fit


class Found(NamedTuple):
    """Choices while they are made; given ones are kept.

    Attributes:
        given: options by name, None for those that are not.
        values, reasons, grades: by name of a choice.
        to_estimate: names of choices that images still have to tell.
        errors: standard errors by name.
        follows: names of those options that follow from another one, and how.
    """

    given: Mapping[str, Any]
    values: dict[str, Any]
    reasons: dict[str, str]
    grades: dict[str, str]
    to_estimate: set[str]
    errors: dict[str, float]
    follows: Mapping[str, str] = MappingProxyType({})

    def take(self, name: str, value: Any, reason: str, grade: str = SURE) -> Any:
        if self.given.get(name) is not None:
            value, reason, grade = self.given[name], self.follows.get(name, "given"), SURE
        self.values[name] = value
        self.explain(name, reason, grade)
        return value

    def explain(self, name: str, reason: str, grade: str = SURE) -> None:
        self.reasons[name], self.grades[name] = reason, grade

    def settle(
        self, name: str, value: Any, reason: str, grade: str, error: float = math.inf
    ) -> None:
        """Take what images tell of a choice that was left to them."""
        self.values[name] = value
        self.to_estimate.discard(name)
        self.explain(name, reason, grade)
        if math.isfinite(error):
            self.errors[name] = error

    def settle_all(self, reason: str) -> None:
        """Leave what images should have told as it is."""
        for name in sorted(self.to_estimate):
            self.settle(name, self.values[name], f"{self.reasons[name]}; {reason}", GUESSED)

    def doubt(self) -> None:
        """What was chosen by the record is a guess."""
        for name, grade in self.grades.items():
            if grade != SURE:
                self.grades[name] = GUESSED

    def estimate_later(self, name: str) -> None:
        """Leave a choice to images, unless it is given."""
        if self.given.get(name) is None:
            self.to_estimate.add(name)

    def take_alpha(self, ratio: float, how: str, grade: str = LIKELY) -> None:
        """alpha and low pass by the power of the noise over that of the sound, and how it is known.

        Args:
            ratio: as in Wiener's filter; alpha is kept within `ALPHAS`.
            how: words that follow the number.
            grade: of that number.
        """
        least, most = ALPHAS
        kept = "raised to the least: " if ratio < least else "capped: " if ratio > most else ""
        why = f"{kept}noise over signal power {ratio:.2g}, {how}"
        alpha = float(self.take("alpha", float(np.clip(ratio, least, most)), why, grade))
        noisy = alpha > CLEAN
        why = "noise" if noisy else "hardly any noise"
        self.take("low_pass", "cosine" if noisy else "none", why, grade)

    def take_laser_energy(self, scan: Scan) -> None:
        """Whether frames are divided by the energy of their pulses: said where the file has it."""
        if "laser_energy" in scan.known:
            why = "in the file; the image is per unit of it"
            self.take("laser_energy", True, why)
        elif self.given.get("laser_energy"):
            raise ValueError("laser_energy is wanted, but the file has no energies of its pulses.")
        else:
            self.values["laser_energy"] = False

    def take_radii(self, radii: np.ndarray) -> None:
        """Equispaced radii of the integrals, (radii,) [length]."""
        if len(radii) < 2:
            raise ValueError(
                "radii would be as far apart as pixels, and the data do not cover two of them: "
                "take more pixels, or a smaller half_width."
            )
        step = float(radii[1] - radii[0])
        self.values.update(first_radius=float(radii[0]), radial_step=step, n_radii=len(radii))

    def require_body_speed(self, kind: str) -> None:
        """Raise ValueError for a part of a body of another speed, where others are missing."""
        asked = [name for name in OF_BODY if self.given.get(name) is not None]
        if not asked:
            return
        if kind != "pressure" or self.values["model"] not in MODELS:
            raise ValueError(f"{asked[0]} is of pressure records in the plane: leave it out.")
        if "water_speed" not in asked:
            raise ValueError(f"{asked[0]} is given, and the speed around it is not: water_speed.")
        if "sound_speed" in self.to_estimate:
            raise ValueError(
                "water_speed is given, and the body's own speed is neither given nor in the file: "
                "give sound_speed too, or two_speeds, to estimate it."
            )

    def take_body(self) -> None:
        """Take the disk of another speed than the water's, where that is given."""
        self.values.update(dict.fromkeys(OF_BODY))
        if self.given.get("water_speed") is None:
            return
        self.take("water_speed", None, "given")
        for name, of_region in zip(OF_BODY[1:], ("region_radius", "region_center"), strict=True):
            self.take(name, self.values[of_region], "the region's", GUESSED)

    def expect(self, missing: str) -> None:
        """Images are fitted where data are missing, in words; "" for none."""
        if missing:
            self.values["model_based"] = True
            self.explain("model_based", f"there is no formula: {missing}")

    def take_constraints(self, kind: str) -> None:
        """Take the choices of fitted images; a given penalty implies that they are fitted.

        Args:
            kind: of the data; the source of a measured pressure is nowhere negative.
        """
        asked = [name for name in OF_CONSTRAINTS if self.given.get(name)]
        if self.given.get("nonnegative") is False:
            asked.append("nonnegative")
        if self.given.get("model_based") is False:
            self._require_direct(asked)
        if self.given.get("weight") == 0:
            asked.append("weight")
        defaults: dict[str, Any] = {"penalty": "tv", "nonnegative": False, "weight": None}
        fitted = self.values.get("model_based", False)
        if asked:
            why = "given" if "model_based" in asked else f"{asked[0]} is given"
            self.explain("model_based", self.reasons["model_based"] if fitted else why)
            fitted = True
        self.values.update(defaults, model_based=fitted)
        if not fitted:
            return
        self._require_no_formula()
        self.take("penalty", "tv", "total variation: for objects with edges", GUESSED)
        measured = kind == "pressure"
        self.take("nonnegative", measured, ADDS if measured else "not asked for", LIKELY)
        self.take("weight", None, "balances penalty and misfit", LIKELY)

    def _require_direct(self, asked: list[str]) -> None:
        """Raise ValueError where the formula is asked for and cannot be, or constraints are too."""
        if self.values.get("model_based"):
            why = self.reasons["model_based"]
            raise ValueError(f"the direct image is asked for, but {why}: leave that out.")
        if asked:
            raise ValueError(
                f"the direct image is asked for, and {asked[0]}, which is of fits: leave one out."
            )

    def _require_no_formula(self) -> None:
        asked = [name for name in OF_FORMULA if self.given.get(name) is not None]
        if asked:
            raise ValueError(
                f"{asked[0]} is of the formula, but images are fitted here "
                f"({self.reasons['model_based']}): leave it out."
            )

    def choices(self) -> Choices:
        """All of them, once all were taken."""
        why = {"reasons": tuple(self.reasons.items()), "grades": tuple(self.grades.items())}
        names = {
            "user_set": tuple(
                name
                for name, value in self.given.items()
                if value is not None and name not in self.follows
            ),
        }
        return Choices.from_settings(
            self.values | why | names | {"standard_errors": tuple(self.errors.items())}
        )


class NoRegion(ValueError):
    """The detectors do not tell where a region of interest could be."""


class Limit(NamedTuple):
    """A highest lambda that can be had [rad/length], what bounds it, and how sure that is."""

    frequency: float
    why: str
    grade: str = SURE


def least(*limits: Limit) -> Limit:
    """The limit that decides."""
    return min(limits, key=lambda limit: limit.frequency)


def radii_of(scan: Scan, found: Found) -> np.ndarray | None:
    """Radii that are given, or those of integrals in the file; refused if they do not increase."""
    own = found.given.get("radii")
    if own is None and scan.kind == "circular_integrals":
        own = scan.known.get("radii")
    if own is None:
        return None
    own = np.asarray(own, float)
    require_radii(jax.device_put(own))
    return own


def take_nominal_speed(scan: Scan, found: Found, units: Units) -> float:
    """Take the speed of the file, or water's until images tell it [length/time]."""
    if "sound_speed" in scan.known:
        return float(found.take("sound_speed", *_one_speed(scan.known["sound_speed"], units)))
    water = nominal_water_speed(units)
    if water is None:
        why = "none in the file, and sizes are not a scanner's: taken to be 1"
        return float(found.take("sound_speed", 1.0, why, GUESSED))
    found.estimate_later("sound_speed")
    why = "none in the file: about that of water, to be estimated"
    return float(found.take("sound_speed", water, why, GUESSED))


def _one_speed(speeds: np.ndarray, units: Units) -> tuple[float, str, str]:
    """The speed of a file, of a map or list its mean; with reason and grade."""
    least, most = float(speeds.min()), float(speeds.max())
    if least == most:
        return most, "from the file", SURE
    of_what = " x ".join(map(str, speeds.shape))
    between = f"{units.of_speed(least)} to {units.of_speed(most)}"
    why = f"the mean of {of_what} speeds in the file, {between}: images are made with one"
    return float(speeds.mean()), why, GUESSED


def slowest(found: Found) -> float:
    """The least speed to search, over the nominal one, for which the record is long enough."""
    return SLOWEST if "sound_speed" in found.to_estimate else 1.0


def covered(
    found: Found, wanted: float, reason: str, radii: np.ndarray | None, distances: np.ndarray
) -> tuple[float, str]:
    """A region's radius and the reason: as asked for, or as far as the radii of the data reach.

    Args:
        wanted, reason: the radius without regard to the data, and why [length].
        radii: of the circles, increasing; None if they are free [length].
        distances: of the detectors from the region's centre [length].

    Raises:
        ValueError: if they cover nothing, where no radius is given.
    """
    if radii is None or found.given.get("region_radius") is not None:
        return wanted, reason
    nearest, farthest = float(distances.min()), float(distances.max())
    most = min(nearest - float(radii[0]), float(radii[-1]) - farthest)
    if most <= SHARES[0] * wanted:
        raise ValueError(
            f"radii run from {radii[0]:.6g} to {radii[-1]:.6g}, and detectors are {nearest:.6g} to "
            f"{farthest:.6g} from the middle: their circles cover no region about it. Check that "
            "radii and positions are in the same unit of length, or give region_center and "
            "region_radius."
        )
    return (wanted, reason) if wanted <= most else (most, "as much as the radii cover")


def require_scale(path: float, radius: float, speed: float) -> None:
    """Raise ValueError for a record too short for anything, or so long that units must differ.

    Args:
        path: of sound, until the record ends [length].
        radius: of the arc [length].
    """
    least = (1 + SHARES[0]) * radius
    if not least <= path <= LONGEST * radius:
        raise ValueError(
            f"at a sound speed of {speed:.6g} the record ends after a path of {path:.4g}, while "
            f"the detectors are {radius:.4g} from their middle: expected {least:.4g} to "
            f"{LONGEST * radius:.4g}. Check that positions, times and sound speed are in units "
            "that fit each other; for a part off the middle give region_center and region_radius."
        )


def require_end(support: Supported, speed: float) -> None:
    """Raise ValueError for a record that ends before sound from the region's far side arrives."""
    if support.ends_early:
        raise ValueError(_too_short(support, speed))


def require_middle(support: Supported, speed: float) -> None:
    """Raise ValueError for a record that ends before sound is half-way to the region's middle."""
    if float(support.end) < 0.5 * (float(support.end) - float(support.reach_of_end)):
        raise ValueError(_too_short(support, speed))


def _too_short(support: Supported, speed: float) -> str:
    return (
        f"{support.shortfalls[0]}. Check that positions, times and sound speed ({speed:.6g}) are "
        "in units that fit each other."
    )


def require_detail(found: Found, highest: float, limit: str) -> None:
    """Raise ValueError for waves longer than the region, unless they were asked for.

    Args:
        highest: lambda_max [rad/length].
        limit: what decides it.
    """
    detail, size = math.pi / highest, 2 * found.values["region_radius"]
    if detail > size and found.given.get("max_frequency") is None:
        raise ValueError(
            f"{limit} allows details of {detail:.3g} (lambda {highest:.4g}), more than the whole "
            f"region, {size:.3g} across. Check that positions, times and sound speed are in units "
            "that fit each other, or give max_frequency."
        )
