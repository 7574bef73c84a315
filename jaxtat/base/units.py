"""Units: computations use those of positions and record; pictures, files and messages name them."""

import math
import re
from collections.abc import Iterable
from decimal import Decimal
from typing import NamedTuple

MILLIMETRES = {"m": 1e3, "cm": 10.0, "mm": 1.0, "um": 1e-3}
MICROSECONDS = {"s": 1e6, "us": 1.0}
OF_VALUES = "initial pressure [arb. unit]"  # of images and volumes, beside a colour bar
ROUNDING = 1e-9  # of a scale: what is less is what rounding left of zero
EXPONENTS = {"ns": -9, "us": -6, "ms": -3, "s": 0}  # of times in seconds
# two digits of an exponent: 1e999999999 would be written out
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,2})?"
_TIME = re.compile(rf"({_NUMBER})\s*({'|'.join(EXPONENTS)})")
_MICRO = str.maketrans("\u00b5\u03bc", "uu")  # a sign and a letter that look alike


def time_of(text: str) -> float | str:
    """A time as a command or a file of settings has it: a number, or text with its unit.

    Raises:
        ValueError: for anything else.

    >>> time_of("-2e-6"), time_of(" 1.375 us")
    (-2e-06, '1.375 us')
    """
    text = text.strip().translate(_MICRO)
    if _TIME.fullmatch(text) and math.isfinite(seconds(text)):
        return text
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(
            f"{text!r:.60} is no time: expected a number, or one with a unit of "
            f"{', '.join(EXPONENTS)}, such as 1.375us."
        )
    return number


def seconds(time: str) -> float:
    """Seconds of a time with its unit, as `time_of` has it, rounded once.

    >>> seconds("1.375us") == 1.375e-6, seconds("-2e1 us"), seconds("40ms")
    (True, -2e-05, 0.04)
    """
    found = _TIME.fullmatch(time)
    assert found is not None, time
    number, unit = found.groups()
    return float(Decimal(number).scaleb(EXPONENTS[unit]))


def millimetres(unit: str | None) -> float:
    """How many millimetres the unit of length has; 1 where it is not known (None).

    Raises:
        ValueError: for a unit that is none of `MILLIMETRES`.

    >>> millimetres("m"), millimetres(None)
    (1000.0, 1.0)
    """
    if unit is not None and unit not in MILLIMETRES:
        raise ValueError(
            f"the unit of length is {unit!r}, expected one of {', '.join(MILLIMETRES)}, or None if "
            "it is not known."
        )
    return 1.0 if unit is None else MILLIMETRES[unit]


class Units(NamedTuple):
    """Units of lengths and times, and quantities as text with their unit where it is known.

    Attributes:
        length: one of `MILLIMETRES`, or None if it is not known.
        time: one of `MICROSECONDS`, or None likewise.

    >>> known, unknown = Units("m", "s"), Units()
    >>> known.of_length(0.01234, 3), unknown.of_length(0.25)
    ('12.3 mm', '0.25')
    >>> known.of_time(2.4871e-6), known.of_speed(1474.674), known.of_wave_number(26409.0)
    ('2.487 us', '1474.67 m/s', '26.409 rad/mm')
    >>> known.of_band(9.8571e4, 1.26111e7), unknown.of_band(0.1, 7.0)
    ('0.09857 to 12.61 MHz', '0.1 to 7')
    >>> known.of_place((7e-18, -0.012), 0.04), unknown.of_place((-0.0, 7e-18), 1.0)
    ('(0, -12) mm', '(0, 0)')
    """

    length: str | None = None
    time: str | None = None

    def in_length(self, unit: str | None) -> "Units":
        """These units with another unit of length, if one is given.

        Raises:
            ValueError: for a unit that is none of `MILLIMETRES`.
        """
        millimetres(unit)
        return self if unit is None else self._replace(length=unit)

    def of_length(self, length: float, digits: int = 4, scale: float = 0.0) -> str:
        """A length in millimetres; zero where rounding left it, beside lengths of ``scale``."""
        return _with(self._millimetres(length, digits, scale), self.length, "mm")

    def of_place(self, place: Iterable[float], scale: float, digits: int = 4) -> str:
        """A position in millimetres, rounded in the same way."""
        shown = ", ".join(self._millimetres(x, digits, scale) for x in place)
        return _with(f"({shown})", self.length, "mm")

    def _millimetres(self, length: float, digits: int, scale: float) -> str:
        length = 0.0 if abs(length) <= ROUNDING * scale else length
        return f"{millimetres(self.length) * length:.{digits}g}"

    def of_time(self, time: float) -> str:
        """A time in microseconds."""
        return _with(f"{self.microseconds * time:.4g}", self.time, "us")

    def of_speed(self, speed: float, digits: int = 6) -> str:
        """A speed in metres per second."""
        number = f"{self.metres_per_second * speed:.{digits}g}"
        return _with(number, self.length and self.time, "m/s")

    @property
    def metres_per_second(self) -> float:
        """Factor from the unit of speed to m/s; 1 where the units are not known."""
        both = self.length and self.time
        return 1e3 * millimetres(self.length) / self.microseconds if both else 1.0

    def of_band(self, low: float, high: float) -> str:
        """Frequencies in megahertz."""
        low, high = low / self.microseconds, high / self.microseconds
        return _with(f"{low:.4g} to {high:.4g}", self.time, "MHz")

    def of_wave_number(self, wave_number: float) -> str:
        """A wave number lambda in radians per millimetre."""
        return _with(f"{wave_number / millimetres(self.length):.5g}", self.length, "rad/mm")

    def in_si(self, quantity: str) -> tuple[float, str | None]:
        """Factor to SI units, and the SI unit; None if the unit is unknown.

        Args:
            quantity: "length", "time", "speed", "frequency", "wave number", "angle", in degrees,
                or "" of a bare number.

        >>> Units("mm", "us").in_si("speed"), Units().in_si("speed")
        ((1000.0, 'm/s'), (1.0, None))
        """
        length, time = millimetres(self.length), self.microseconds
        factor, unit, known = {
            "length": (length / 1e3, "m", self.length),
            "time": (time / 1e6, "s", self.time),
            "speed": (1e3 * length / time, "m/s", self.length and self.time),
            "frequency": (1e6 / time, "Hz", self.time),
            "wave number": (1e3 / length, "rad/m", self.length),
            "angle": (1.0, "degree", True),
            "": (1.0, None, True),
        }[quantity]
        return (factor, unit) if known else (1.0, None)

    @property
    def microseconds(self) -> float:
        """Factor from the unit of time to microseconds; 1 where it is not known."""
        return MICROSECONDS[self.time] if self.time else 1.0


def _with(number: str, known: str | None, unit: str) -> str:
    return f"{number} {unit}" if known else number
