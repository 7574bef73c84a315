"""Speed of sound of a scan in space, and whether any volume explains its record.

Opposite detectors tell both within seconds. Where they do not agree, or where there are none, the
best volume is asked, see `misfit_in_space`. It explains the record unless it leaves 0.4 of it or
more, and more than 0.6 of what it leaves with the rows mixed, both squared, at any speed of sound.
Of detectors on half of the sphere or more it also tells the speed: from less of the sphere, least
is left at speeds that are 0.3 to 6 % off, by cups of 256 and 500 elements.
"""

import warnings
from functools import partial
from typing import NamedTuple

import numpy as np

from ..base.choice_table import GUESSED, SURE
from ..spherical.visible import covered_share
from ..steps import Contradiction
from .acoustics import EXPLAINED, NO_IMAGE_SAYS
from .acquisition import FASTEST, SLOWEST, nominal_water_speed
from .choices import Choices
from .estimate import Estimate, Source
from .misfit import Misfit, Sound
from .misfit_in_space import (
    IN_SPACE,
    NO_WEIGHT,
    all_that_sounds,
    misfit_of_volumes,
    points_in_space,
    power_within,
    sound_in_space,
)
from .opposite_detectors import AGREE, agreement, speed_in_space
from .parameters import Parameters
from .preprocess import AcquisitionInSpace
from .sound_speed import Least, least_share
from .speed_found import UNSURE, unknown, with_speed
from .start_time import with_start_untold

NO_VOLUME = 0.6  # share² over that of mixed rows, from which no volume explains a record
HALF = 0.48  # of the sphere about the middle, from which on a volume tells the speed
HELD = 0.01  # of the record's power, that coarse voxels hold, at least
STEP = 1 / 60  # between speeds, over water's
STRETCHES = np.arange(SLOWEST, FASTEST + STEP / 2, STEP)  # speeds that are tried, over nominal


def tell_acoustics_in_space(record: AcquisitionInSpace, p: Parameters) -> Choices:
    """Choices with the estimated sound speed, with a warning if no volume explains the record.

    Where the file does not say when the record starts, speeds are guesses: neither opposite
    detectors nor the best volume tell a start from a speed.

    Args:
        record: of pressure.
        p: behind all other stages.
    """
    made = _by_the_files_start(record, p)
    in_units = nominal_water_speed(p.units) is not None
    if made.grade("sound_speed") == SURE or not (p.nominal("time_shift") and in_units):
        return made
    return with_start_untold(made, record.facts.radius)


def _by_the_files_start(record: AcquisitionInSpace, p: Parameters) -> Choices:
    """With the start that the file says, or time 0."""
    made, nominal, scan = p.choices(), p.nominal("sound_speed"), record.scan
    if p.gives("water_speed") or p.gives("body_radius"):
        return made
    otherwise = made
    if nominal:
        opposite = speed_in_space(scan, made)
        otherwise = with_speed(made, opposite)
        if "agreement" in opposite.data or nominal_water_speed(p.units) is None:
            return otherwise
    elif agreement(scan, made) >= AGREE:
        return made
    sound = sound_in_space(record, made, all_that_sounds(record, p, made))
    if sound is None:
        return otherwise
    misfit = misfit_of_volumes(sound, (SLOWEST * made.sound_speed, FASTEST * made.sound_speed))
    if power_within(sound, misfit, made.sound_speed) < HELD:
        return otherwise
    told = nominal and covered_share(points_in_space(scan, made)) >= HALF
    return _by_volumes(Asked(sound, misfit, made.sound_speed), p, made, told=told)


class Asked(NamedTuple):
    """The best volumes at some speeds.

    Attributes:
        sound, misfit: see `misfit_in_space`.
        speed: of the file, the one given, or water's [length/time].
    """

    sound: Sound
    misfit: Misfit
    speed: float

    def least(self, *, sought: bool) -> Least:
        """Where least is left, of all speeds or at the one that is known."""
        fit_at = partial(self.misfit.best, weight=NO_WEIGHT)
        if not sought:
            return Least(self.speed, np.inf, 0.0, fit_at(self.speed))
        return least_share(fit_at, self.speed * STRETCHES, self.sound.good, IN_SPACE)

    def chance(self, least: Least) -> float:
        """The share that is left with the rows mixed."""
        return self.misfit.with_rows_mixed().best(least.value, weight=NO_WEIGHT).share


def _by_volumes(asked: Asked, p: Parameters, made: Choices, *, told: bool) -> Choices:
    """Choices with what the best-fitting volumes give.

    Args:
        told: whether they tell the speed.
    """
    least, nominal = asked.least(sought=told), p.nominal("sound_speed")
    chance = asked.chance(least)
    if _unexplained(least, chance) and not told:
        least = asked.least(sought=True)
    if _unexplained(least, chance):
        data = {"least": least.fit.share, "chance": chance}
        warnings.warn(f"{NO_IMAGE_SAYS.format(**data)}.", Contradiction, stacklevel=8)
        return p.doubted(NO_IMAGE_SAYS, ("sound_speed",) if nominal else (), **data).choices()
    if nominal:
        return with_speed(made, _speed(least, asked.speed, told=told))
    if least.distinct and abs(least.value / asked.speed - 1) > UNSURE:
        better = made.units.of_speed(least.value)
        why = f"{dict(made.reasons)['sound_speed']}; at {better} a volume explains it better"
        return made.with_reason("sound_speed", why, GUESSED)
    return made


def _unexplained(least: Least, chance: float) -> bool:
    """Whether little is explained, and of mixed rows nearly as much."""
    return not least.distinct and least.fit.share >= max(EXPLAINED, NO_VOLUME**0.5 * chance)


def _speed(least: Least, nominal: float, *, told: bool) -> Estimate:
    """Over the nominal one."""
    if not told:
        return unknown("detectors on less than half of the sphere do not tell another")
    if not least.distinct:
        return unknown("no other speed leaves clearly less of the record unexplained")
    why = (
        "the best volume leaves {share:.0%} unexplained, least of all speeds; none in the file, "
        "and opposite detectors do not tell it"
    )
    value, error = least.value / nominal, least.standard_error / nominal
    return Estimate(value, why, GUESSED, Source.ESTIMATE, error, {"share": least.fit.share})
