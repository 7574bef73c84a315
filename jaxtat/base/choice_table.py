"""Table of the choices of a reconstruction: options, settings, checks and tables follow from it.

A module that imports nothing heavy: the command's help is quick with it. A new choice is a line
here, a field of `scans.Choices`, and what decides it in `scans`.
"""

import math
from collections.abc import Callable, Mapping
from decimal import Decimal
from numbers import Real
from typing import Any, NamedTuple

from .option_values import INVERSIONS, LOW_PASSES, MODELS, PENALTIES
from .units import seconds, time_of

SURE, LIKELY, GUESSED = GRADES = ("sure", "likely", "guessed")
"""Given, in the file, or following from it; what the data show, by a rule; nothing shows it."""
POSITIVE = "above zero"
NOT_NEGATIVE = "0 or above"
_MOST = 2**24  # radii, or pixels a side


class Choice(NamedTuple):
    """One choice.

    Attributes:
        name: of the field of `scans.Choices`; its option is ``--name``.
        read: its value from plain numbers and text, as in a file of settings.
        shown: its value in words, for the table; None to leave it out.
        group: of options, under which the command has it; None if it has none.
        option: how argparse reads it.
        bound: what a number must be, `POSITIVE` or `NOT_NEGATIVE`; none by default.
        quantity: one of `Units.in_si`, of a number with a unit.
        off, off_help: name of the option that says no, of a choice between yes and no.
    """

    name: str
    read: Callable[[Any], Any]
    shown: Callable[[Any], str] | None = None
    group: str | None = None
    option: Mapping[str, Any] = {}
    bound: str = ""
    quantity: str = ""
    off: str = ""
    off_help: str = ""

    @property
    def is_number(self) -> bool:
        """Whether its option takes a single number."""
        return self.option.get("type") in (int, float, "time") and "nargs" not in self.option

    def stored(self, value: Any) -> Any:
        """Its value from a settings file, or ValueError if that is not allowed."""
        try:
            result = self.read(value)
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"{self.name} is {value!r:.60}, which it cannot be.") from None
        self.require(result)
        return result

    def require(self, value: Any, name: str | None = None) -> None:
        """Raise ValueError for a number out of bounds; None means not chosen yet."""
        if value is None or not self.bound:
            return
        number = seconds(value) if isinstance(value, str) else value
        least = number > 0 if self.bound == POSITIVE else number >= 0
        if not (least and number < math.inf):
            raise ValueError(
                f"{name or self.name} is {value}, expected a finite number, {self.bound}."
            )


def _number(value: Any) -> float:
    if isinstance(value, str | bool) or not math.isfinite(value):
        raise TypeError
    return float(value)


def _time(value: Any) -> float | str:
    return time_of(value) if isinstance(value, str) else _number(value)


def _whole(value: Any) -> int:
    if _number(value) != int(value):
        raise TypeError
    return int(value)


def _wholes(values: Any) -> tuple[int, ...]:
    return tuple(_whole(k) for k in values)


def _numbers(values: Any) -> tuple[float, ...]:
    return tuple(_number(x) for x in values)


def _number_or_none(value: Any) -> float | None:
    return None if value is None else _number(value)


def _so_many(n: int, values: Any) -> list[float]:
    numbers = list(_numbers(values))
    if len(numbers) != n:
        raise TypeError
    return numbers


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError
    return value


def _flag(value: Any) -> bool:
    if value not in (True, False):
        raise TypeError
    return bool(value)


def _count(value: Any) -> int:
    if not 1 <= _whole(value) <= _MOST:
        raise TypeError
    return int(value)


def _pair(values: Any) -> tuple[float, float] | None:
    if values is None:
        return None
    first, second = values
    return _number(first), _number(second)


def _cut(c: Any) -> str:
    radius = c.region_radius
    return c.units.of_length(c.region_cut, scale=radius) if c.region_cut < radius else "none"


def _by(c: Any, lengths: tuple[float, float] | None) -> str:
    return " x ".join(c.units.of_length(x) for x in lengths or ())


def _degrees(angle: float | None) -> str:
    return f"{round(angle or 0.0, 1) + 0.0:g} degrees"


PLAIN, RECORD, REGION, IMAGE, METHOD = "plain", "record", "region", "image", "method"
CONSTRAINTS = "constraints"
_NUMBER = {"type": float}
_TIME = {"type": "time", "metavar": "T"}  # a type of the command's parser

CHOICES = (
    Choice("order", _wholes),
    Choice("left_out", _wholes),
    Choice(
        "model",
        _text,
        lambda c: c.model,
        RECORD,
        {"choices": MODELS, "help": "of a scanner's sizes in-plane, else 2d"},
    ),
    Choice(
        "sound_speed",
        _number,
        lambda c: c.units.of_speed(c.sound_speed),
        RECORD,
        _NUMBER
        | {
            "metavar": "C",
            "help": "default: from the file, else the best image's, or 1 without metres and "
            "seconds",
        },
        POSITIVE,
        "speed",
    ),
    Choice(
        "water_speed",
        _number_or_none,
        lambda c: c.units.of_speed(c.water_speed),
        RECORD,
        _NUMBER
        | {
            "metavar": "C",
            "help": "around the body, where that is another one; --sound-speed is the body's then "
            "(default: looked for, see --two-speeds)",
        },
        POSITIVE,
        "speed",
    ),
    Choice(
        "body_radius",
        _number_or_none,
        lambda c: c.units.of_length(c.body_radius),
        RECORD,
        _NUMBER | {"metavar": "R", "help": "of the body in --water-speed (default: the region's)"},
        POSITIVE,
        "length",
    ),
    Choice(
        "body_center",
        lambda values: None if values is None else _numbers(values),
        lambda c: c.units.of_place(c.body_center, c.body_radius),
        RECORD,
        _NUMBER
        | {
            "nargs": "+",
            "metavar": ("X1", "X2"),
            "help": "and X3 in space (default: the region's)",
        },
        quantity="length",
    ),
    Choice(
        "body_axes",
        _pair,
        lambda c: _by(c, c.body_axes),
        RECORD,
        _NUMBER
        | {
            "nargs": 2,
            "metavar": ("A", "B"),
            "help": "half axes of a body that is an ellipse, in either order (default: a disk)",
        },
        quantity="length",
    ),
    Choice(
        "body_angle",
        _number_or_none,
        lambda c: _degrees(c.body_angle),
        RECORD,
        _NUMBER | {"metavar": "DEG", "help": "direction of A, from x1 towards x2 (default: 0)"},
        quantity="angle",
    ),
    Choice(
        "impulse_response",
        _flag,
        lambda c: "removed" if c.impulse_response else "kept",
    ),
    Choice(
        "laser_energy",
        _flag,
        lambda c: "divided out" if c.laser_energy else "not corrected",
    ),
    Choice(
        "time_shift",
        _number,
        lambda c: c.units.of_time(c.time_shift),
        RECORD,
        _TIME | {"help": "added to the times of the record: 0.2us, or a number in their unit"},
        quantity="time",
    ),
    Choice(
        "dead_time",
        _number,
        lambda c: c.units.of_time(c.dead_time),
        RECORD,
        _TIME | {"help": "silence the start"},
        NOT_NEGATIVE,
        "time",
    ),
    Choice(
        "band",
        _pair,
        lambda c: c.units.of_band(*c.band) if c.band else "none",
        RECORD,
        {
            "nargs": "+",
            "metavar": "F",
            "help": "LOW HIGH of a band-pass [cycles/time], or none",
        },
        quantity="frequency",
    ),
    Choice(
        "region_radius",
        _number,
        lambda c: c.units.of_length(c.region_radius),
        REGION,
        _NUMBER | {"metavar": "R"},
        POSITIVE,
        "length",
    ),
    Choice(
        "region_cut",
        _number,
        _cut,
        REGION,
        _NUMBER | {"metavar": "X", "help": "default: a whole disk"},
        quantity="length",
    ),
    Choice(
        "region_angle",
        _number,
        lambda c: _degrees(c.region_angle),
        REGION,
        _NUMBER | {"metavar": "DEG", "help": "outward normal of the cut"},
        quantity="angle",
    ),
    Choice(
        "region_size",
        _pair,
        lambda c: _by(c, c.region_size),
        REGION,
        _NUMBER | {"nargs": 2, "metavar": ("W", "H"), "help": "of a rectangle in place of a disk"},
        quantity="length",
    ),
    Choice(
        "region_center",
        _numbers,
        lambda c: c.units.of_place(c.region_center, c.region_radius),
        REGION,
        _NUMBER | {"nargs": 2, "metavar": ("X1", "X2")},
        quantity="length",
    ),
    Choice("first_radius", _number),
    Choice("radial_step", _number),
    Choice("n_radii", _count),
    Choice(
        "max_frequency",
        _number,
        lambda c: c.units.of_wave_number(c.max_frequency),
        METHOD,
        _NUMBER | {"metavar": "LAMBDA", "help": "[rad/length]"},
        POSITIVE,
        "wave number",
    ),
    Choice(
        "pixels",
        _count,
        lambda c: f"{c.pixels}",
        IMAGE,
        {"type": int, "metavar": "N", "help": "N x N (default: by what is resolved)"},
    ),
    Choice(
        "half_width",
        _number,
        lambda c: c.units.of_length(c.half_width),
        IMAGE,
        _NUMBER | {"metavar": "B", "help": "default: the region's radius"},
        POSITIVE,
        "length",
    ),
    Choice(
        "alpha",
        _number,
        lambda c: f"{c.alpha:.2g}",
        PLAIN,
        _NUMBER
        | {
            "metavar": "A",
            "help": "Tikhonov regularisation, of a reconstruction without a plan; default: noise "
            "over signal power of a pressure record, by cross-validation of two-dimensional waves, "
            "1e-6 for circular integrals",
        },
        POSITIVE,
    ),
    Choice(
        "low_pass",
        _text,
        lambda c: c.low_pass,
        PLAIN,
        {"choices": LOW_PASSES, "help": "default: by the noise"},
    ),
    Choice(
        "inversion",
        _text,
        lambda c: c.inversion,
        PLAIN,
        {
            "choices": INVERSIONS,
            "help": "last step: a Fourier sum (default), or the slower back-projection",
        },
    ),
    Choice(
        "model_based",
        _flag,
        lambda c: "yes" if c.model_based else "no",
        CONSTRAINTS,
        {
            "action": "store_true",
            "default": None,
            "help": "the image that fits the data and costs least, by iterations (default: of "
            "pressure records); any of the options below says so too",
        },
        off="direct",
        off_help="the image by the formula, in one pass",
    ),
    Choice(
        "penalty",
        _text,
        lambda c: c.penalty,
        CONSTRAINTS,
        {"choices": PENALTIES, "help": "what costs (default: tv, total variation)"},
    ),
    Choice(
        "nonnegative",
        _flag,
        lambda c: "f >= 0" if c.nonnegative else "no",
        CONSTRAINTS,
        {
            "action": "store_true",
            "default": None,
            "help": "no pixel is below zero (default for pressure records)",
        },
        off="signed",
        off_help="pixels may be below zero",
    ),
    Choice(
        "weight",
        _number_or_none,
        lambda c: "from the misfit" if c.weight is None else f"{c.weight:.3g}",
        CONSTRAINTS,
        _NUMBER | {"metavar": "W", "help": "of the penalty (default: by what is not explained)"},
        NOT_NEGATIVE,
    ),
)
"""All choices, in the order of the printed table."""

BESIDES = (
    Choice("arc", lambda values: _so_many(3, values)),
    Choice("ring", lambda values: _so_many(2, values)),
    *(Choice(name, _text) for name in ("scanner", "use", "frames")),
    Choice("sampling_rate", _number, bound=POSITIVE),
    Choice("duration", _time, bound=POSITIVE),
    Choice("start_time", _time),
    Choice("impulse_response_file", _text),
    Choice("element_band", lambda values: _so_many(2, values)),
    *(Choice(name, _number, bound=NOT_NEGATIVE) for name in ("K", "j_max", "sigma_min")),
    *(Choice(name, _flag) for name in ("series", "collocation", "single")),
)
"""What settings say of the scan and of plans beside the choices; None if they do not."""

OFF = {choice.name: choice.off for choice in CHOICES if choice.off} | {"two_speeds": "one_speed"}
"""Options that say no, by name of the choice."""

OPTIONS = tuple(choice for choice in CHOICES if choice.group is not None)
NUMBERS = tuple(choice.name for choice in OPTIONS if choice.is_number)
OF_CONSTRAINTS = tuple(choice.name for choice in CHOICES if choice.group == CONSTRAINTS)
OF_TWO_SPEEDS = ("two_speeds", "water_temperature", "body_shape")
"""What is asked of the choices of two speeds, and is none of them."""

BODY_SHAPES = ("disk", "ellipse")
"""Of bodies that are estimated; in space a disk is a ball."""

OF_REGION = tuple(choice.name for choice in CHOICES if choice.group in (REGION, IMAGE))


def choice_named(name: str) -> Choice:
    """The choice of that name."""
    return next(choice for choice in CHOICES if choice.name == name)


def option_of(name: str) -> str:
    """--sound-speed for sound_speed, --impulse-response for impulse_response_file."""
    return f"--{name.removesuffix('_file').replace('_', '-')}"


def words_of(name: str, value: Any) -> list[str]:
    """An option and its values, as words of a command line; an empty list if it has no value.

    Numbers have ten digits and no exponent: argparse takes -1e-05 for an option.

    >>> words_of("region_center", (0.1, -1e-5)), words_of("quiet", True), words_of("alpha", None)
    (['--region-center', '0.1', '-0.00001'], ['--quiet'], [])
    """
    if value is False and name in OFF:
        return [option_of(OFF[name])]
    if value is None or value is False:
        return []
    if value is True:
        return [option_of(name)]
    words = [_word(x) for x in (value if isinstance(value, list | tuple) else [value])]
    if len(words) == 1 and words[0].startswith("-"):  # a text, say "-100:"
        return [f"{option_of(name)}={words[0]}"]
    return [option_of(name), *words]


def _word(value: Any) -> str:
    return f"{Decimal(f'{value:.10g}'):f}" if isinstance(value, float) else str(value)


def require_pixels(pixels: Any, name: str = "pixels") -> None:
    """Raise ValueError for fewer than 4 pixels, or a number that is not whole; None is fine."""
    if pixels is None:
        return
    number = pixels.item() if getattr(pixels, "ndim", None) == 0 else pixels  # as a file has it
    if not isinstance(number, Real) or number != number // 1 or number < 4:
        raise ValueError(f"{name} is {pixels!r}, expected a whole number of at least 4.")
