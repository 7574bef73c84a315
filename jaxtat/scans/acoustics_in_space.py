"""Speed of sound of a scan in space, and whether any volume explains its record.

Opposite detectors tell both within seconds. Where they do not agree, or where there are none, the
best volume is asked, see `misfit_in_space`: whether it leaves less of the record than of one with
its rows mixed, and of detectors on half of the sphere at which speed it leaves least. From less of
the sphere least is left at speeds that are 0.3 to 6 % off, by cups of 256 and 500 elements.
"""

import warnings
from functools import partial

import numpy as np

from ..base.choice_table import GUESSED, SURE
from ..geometry import DetectorPoints
from ..io import Scan
from ..spherical.visible import covered_share
from ..steps import Contradiction
from .acoustics import EXPLAINED, FEWEST_SAMPLES, NO_IMAGE_SAYS
from .acquisition import FASTEST, SLOWEST
from .choices import Choices
from .estimate import Estimate, Source
from .misfit_in_space import (
    IN_SPACE,
    NO_WEIGHT,
    misfit_in_space,
    power_within,
    sound_in_space,
)
from .opposite_detectors import AGREE, agreement, speed_in_space
from .parameters import Parameters
from .sound_speed import Least, least_share
from .speed_found import unknown, with_speed
from .start_time import with_start_untold

NO_VOLUME = 0.6  # share² over that of mixed rows, from which no volume explains a record
HALF = 0.48  # of the sphere about the middle, from which on a volume tells the speed
HELD = 0.01  # of the record's power, that coarse voxels hold, at least
STEP = 1 / 60  # between speeds, over water's
STRETCHES = np.arange(SLOWEST, FASTEST + STEP / 2, STEP)  # speeds that are tried, over nominal


def acoustics_in_space(scan: Scan, p: Parameters) -> Choices:
    """Choices with the speed that the record tells, with a warning if no volume explains it.

    Where the file does not say when the record starts, speeds are guesses: neither opposite
    detectors nor the best volume tell a start from a speed.

    Args:
        scan: in space, of pressure.
        p: behind all other stages.
    """
    made = _by_the_files_start(scan, p)
    if made.grade("sound_speed") == SURE or not p.nominal("time_shift"):
        return made
    points = np.asarray(scan.known["detectors"], float)[list(made.channels)]
    distance = np.linalg.norm(points - np.asarray(made.region_center), axis=1)
    return with_start_untold(made, float(distance.mean()))


def _by_the_files_start(scan: Scan, p: Parameters) -> Choices:
    made, nominal = p.choices(), p.nominal("sound_speed")
    if p.gives("water_speed") or p.gives("body_radius"):
        return made
    if nominal:
        opposite = speed_in_space(scan, made)
        if opposite.source is Source.ESTIMATE:
            return with_speed(made, opposite)
    elif agreement(scan, made) >= AGREE:
        return made
    sound = sound_in_space(scan, made)
    within = (sound.times >= sound.start) & (sound.times <= sound.end)
    if np.count_nonzero(within) < FEWEST_SAMPLES:
        return made
    speed, curve = made.sound_speed, sound.curve
    assert isinstance(curve, DetectorPoints)
    told = nominal and covered_share(curve) >= HALF
    misfit = misfit_in_space(sound, (SLOWEST * speed, FASTEST * speed))
    if power_within(sound, misfit, speed) < HELD:
        return made
    fit_at = partial(misfit.best, weight=NO_WEIGHT)
    if told:
        least = least_share(fit_at, speed * STRETCHES, sound.good, IN_SPACE)
    else:
        least = Least(speed, np.inf, 0.0, fit_at(speed))
    chance = misfit.with_rows_mixed().best(least.value, weight=NO_WEIGHT).share
    share = least.fit.share
    if not least.distinct and share >= max(EXPLAINED, NO_VOLUME**0.5 * chance):
        data = {"least": share, "chance": chance}
        warnings.warn(f"{NO_IMAGE_SAYS.format(**data)}.", Contradiction, stacklevel=6)
        return p.doubted(NO_IMAGE_SAYS, ("sound_speed",) if nominal else (), **data).choices()
    return with_speed(made, _speed(least, speed, told=told)) if nominal else made


def _speed(least: Least, nominal: float, *, told: bool) -> Estimate:
    """Over the nominal one."""
    if not told:
        return unknown("detectors on less than half of the sphere do not tell another")
    if not least.distinct:
        return unknown("no speed within 10 % of it leaves clearly less of the record unexplained")
    why = (
        "the best volume leaves {share:.0%} unexplained, least of all speeds; none in the file, "
        "and hardly any detectors have others opposite"
    )
    value, error = least.value / nominal, least.standard_error / nominal
    return Estimate(value, why, GUESSED, Source.ESTIMATE, error, {"share": least.fit.share})
