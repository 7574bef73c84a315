"""Messages about files: one short line, however long the message of the library was."""

from pathlib import Path

LONGEST_MESSAGE = 300  # characters
_LONGEST_NAME = 100


def name_of(path: str | Path) -> str:
    """A path as messages show it; long ones are cut to their end.

    >>> name_of("/data/" + 50 * "deep/" + "scan.npz")[:12]
    '...eep/deep/'
    """
    name = _in_one_line(str(path))
    return name if len(name) <= _LONGEST_NAME else f"...{name[3 - _LONGEST_NAME :]}"


def require_file(path: str | Path) -> None:
    """Raise FileNotFoundError if there is no such path, ValueError if it is not a file."""
    place = Path(path)
    if not place.exists():
        raise FileNotFoundError(f"there is no file {name_of(path)}.")
    if not place.is_file():
        what = "a folder" if place.is_dir() else "a pipe or a device"
        raise ValueError(f"{name_of(path)} is {what}, expected a file.")
    place.open("rb").close()  # PermissionError where it may not be read


def one_line(before: str, reason: str, after: str = "") -> str:
    """A message of at most `LONGEST_MESSAGE` characters; the reason is shortened if necessary."""
    reason, room = _in_one_line(reason), LONGEST_MESSAGE - len(before) - len(after)
    return before + (reason if len(reason) <= room else f"{reason[: room - 3]}...") + after


def reason_of(error: Exception) -> str:
    """The text of an error without the number that Python puts before those of the system.

    >>> reason_of(OSError(28, "cannot write a.h5: No space left on device"))
    'cannot write a.h5: No space left on device'
    """
    return _in_one_line(str(error).removeprefix(f"[Errno {getattr(error, 'errno', None)}] "))


def _in_one_line(text: str) -> str:
    """Text without line breaks and control characters of terminals."""
    return " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())
