"""An estimate of one parameter: value, source, grade, and the data of its sentence in the table."""

import string
from collections.abc import Mapping
from enum import IntEnum
from typing import Any, NamedTuple

from ..base.choice_table import SURE
from ..base.units import Units


class Source(IntEnum):
    """Where a value comes from; it replaces one of the same or of a later source."""

    USER = 0
    FILE = 1
    ESTIMATE = 2
    """Estimated from the record by a rule."""
    DEFAULT = 3
    NOMINAL = 4
    """A default until the value is estimated by images."""


class Estimate(NamedTuple):
    """What is known of one parameter.

    Attributes:
        value: in the units of the scan.
        why: the sentence of the table, with places for ``data``, as for `str.format`; the formats
            ``length``, ``time``, ``speed`` and ``wave_number`` write the unit too. None by "".
        grade: how far the value can be trusted.
        source: where it comes from.
        standard_error: [unit of the value].
        data: what the sentence is made of.
    """

    value: Any
    why: str = ""
    grade: str = SURE
    source: Source = Source.DEFAULT
    standard_error: float | None = None
    data: Mapping[str, Any] = {}

    def sentence(self, units: Units) -> str:
        """Why the value is as it is.

        >>> heard = Estimate(0.02, "from within {reach:length}", data={"reach": 0.018})
        >>> heard.sentence(Units("m", "s"))
        'from within 18 mm'
        """
        return _Sentence(units).vformat(self.why, (), self.data)

    def but(self, why: str, grade: str, **data: Any) -> "Estimate":
        """The same, with more words and another grade."""
        return self._replace(why=self.why + why, grade=grade, data={**self.data, **data})


class _Sentence(string.Formatter):
    def __init__(self, units: Units) -> None:
        self.units = units

    def format_field(self, value: Any, format_spec: str) -> str:
        quantity, *digits = format_spec.split()[:2] or [""]
        if quantity in ("length", "time", "speed", "wave_number"):
            return getattr(self.units, f"of_{quantity}")(value, *map(int, digits))
        return format(value, format_spec)
