"""What is said of files that are refused."""

from pathlib import Path

import pytest

from jaxtat.base.messages import LONGEST_MESSAGE, name_of
from jaxtat.io.limits import refusing

ERRORS = (ValueError, OSError, RuntimeError, RecursionError, MemoryError, TypeError, KeyError)


@pytest.mark.parametrize("error", ERRORS)
@pytest.mark.parametrize("text", ["short", "lines\nof\x1b[2J text", 9000 * "x"])
def test_every_error_is_one_short_line(error, text):
    name = name_of(Path("/a/" + 300 * "b/" + "scan.h5"))
    begins = r"^cannot read \.\.\..*b/scan\.h5: .*: mend it\.$"
    with (
        pytest.raises(ValueError, match=begins) as found,
        refusing(f"cannot read {name}: ", after=": mend it."),
    ):
        raise error(text)
    assert len(str(found.value)) <= LONGEST_MESSAGE
    assert str(found.value).isprintable()
    assert text[:5] in str(found.value)


def test_what_the_system_and_the_user_refuse_stays():
    for error in (PermissionError, KeyboardInterrupt):
        with pytest.raises(error), refusing("cannot read a.h5: "):
            raise error
