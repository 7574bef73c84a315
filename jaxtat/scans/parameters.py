"""The parameters of a reconstruction while stages of `pipeline` estimate them.

What the user gave is kept against the file, the file against estimates, estimates against defaults.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ..base.choice_table import GUESSED, SURE
from ..base.units import Units
from .choices import Choices
from .estimate import Estimate, Source


@dataclass(frozen=True)
class Parameters:
    """Estimates by name of a choice.

    Attributes:
        given: options by name, None for those that are not.
        units: of the scan.
        estimates: what is known by now; that of ``channels`` has no value.
    """

    given: Mapping[str, Any]
    units: Units
    estimates: Mapping[str, Estimate] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Any:
        return self.estimates[name].value

    @property
    def values(self) -> dict[str, Any]:
        """By name."""
        return {name: known.value for name, known in self.estimates.items()}

    def user(self, name: str) -> Any:
        """What the user gave, or what follows from that; None if nothing."""
        known = self.estimates.get(name)
        return known.value if known and known.source is Source.USER else self.given.get(name)

    def gives(self, name: str) -> bool:
        """Whether the user gave it, or what it follows from."""
        return self.user(name) is not None

    def nominal(self, name: str) -> bool:
        """Whether it is still to be estimated by images."""
        known = self.estimates.get(name)
        return known is not None and known.source is Source.NOMINAL

    def with_(self, **estimates: Estimate) -> "Parameters":
        """With these estimates, unless there is one of a better source."""
        return self.replaced(**{name: self._best(name, new) for name, new in estimates.items()})

    def _best(self, name: str, new: Estimate) -> Estimate:
        if self.given.get(name) is not None:
            return Estimate(self.given[name], "given", source=Source.USER)
        known = self.estimates.get(name)
        return new if known is None or new.source <= known.source else known

    def replaced(self, **estimates: Estimate) -> "Parameters":
        """With these estimates, whatever was known."""
        return replace(self, estimates={**self.estimates, **estimates})

    def fixed(self, **values: Any) -> "Parameters":
        """With these values, of which there is no choice, and which the table leaves out."""
        return self.replaced(**{name: Estimate(value) for name, value in values.items()})

    def settled(self, why: str, names: Iterable[str], **data: Any) -> "Parameters":
        """An estimate by images failed: the value stays a guess, with the reason."""
        known = {name: self.estimates[name] for name in names if self.nominal(name)}
        return self.replaced(
            **{
                name: nominal.but(f"; {why}", GUESSED, **data)._replace(source=Source.DEFAULT)
                for name, nominal in known.items()
            }
        )

    def doubted(self, why: str, names: Iterable[str], **data: Any) -> "Parameters":
        """The same after a contradiction; every estimate from the record becomes a guess."""
        unsure = {name: known for name, known in self.estimates.items() if known.grade != SURE}
        guesses = {name: known._replace(grade=GUESSED) for name, known in unsure.items()}
        return self.replaced(**guesses).settled(why, names, **data)

    def choices(self) -> Choices:
        """All of them as they are used, printed and stored."""
        named = {name: e for name, e in self.estimates.items() if e.why}
        errors = ((name, e.standard_error) for name, e in named.items())
        values = self.values
        del values["channels"]
        return Choices.from_settings(
            values
            | {
                "units": self.units,
                "reasons": tuple((name, e.sentence(self.units)) for name, e in named.items()),
                "grades": tuple((name, e.grade) for name, e in named.items()),
                "standard_errors": tuple(pair for pair in errors if pair[1] is not None),
                "user_set": tuple(n for n, value in self.given.items() if value is not None),
            }
        )
