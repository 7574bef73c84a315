"""Writing files so that no reader sees a half-written one."""

import os
import platform
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hashlib import blake2b
from pathlib import Path
from uuid import uuid4

from .messages import name_of, one_line

_LEAST = 4096  # bytes for which there must be room


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A temporary path beside ``path`` that takes its place when the block ends without error.

    The temporary name keeps the suffix, since some writers choose the format by it. Of a symbolic
    link the file it points to is replaced. A process that is killed cannot clean up: what it left
    is removed by the next that writes the same file.

    Raises:
        ValueError: for a place where no file can be written, see `require_place`.
        OSError: if there is no more room, or whatever else the system says, with the file's name.

    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "note.txt"
    >>> with replacing(target) as temporary:
    ...     _ = temporary.write_text("done")
    >>> target.read_text(), len(list(target.parent.iterdir()))
    ('done', 1)
    """
    require_place(path)
    target = Path(path).resolve()
    with suppress(OSError):  # a folder that may not be listed, a file of another user
        _sweep(target)
    temporary = target.with_name(f"{_mark(target)}{os.getpid()}-{uuid4().hex[:8]}{target.suffix}")
    try:
        temporary.touch(exist_ok=False)
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())  # a disk may find only now that it is full
        temporary.replace(target)
    except OSError as error:
        reason = one_line(f"cannot write {name_of(target)}: ", error.strerror or str(error))
        raise OSError(*([error.errno] if error.errno else []), reason) from error
    finally:
        temporary.unlink(missing_ok=True)


def _mark(target: Path) -> str:
    """Prefix of temporary names for a file on this computer; the process id follows."""
    host = blake2b(platform.node().encode(), digest_size=4).hexdigest()
    return f".{target.name[:40]}.{host}-"


def _sweep(target: Path) -> None:
    """Remove temporary files whose writers were killed: no process has their id."""
    if os.name != "posix":  # elsewhere to ask for a process may end it
        return
    mark = _mark(target)
    for name in os.listdir(target.parent):
        writer = name.removeprefix(mark).partition("-")[0]
        if name.startswith(mark) and writer.isdecimal() and not _is_running(int(writer)):
            (target.parent / name).unlink(missing_ok=True)


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)  # sends nothing
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        pass
    return True


def require_new(path: str | Path) -> None:
    """Raise ValueError unless a file that is not there yet can be written."""
    if Path(path).exists():
        raise ValueError(f"cannot write {path}: it is there already, and this needs a new file.")
    require_place(path)


def require_place(path: str | Path) -> None:
    """Raise ValueError if ``path`` cannot be written. Checked before long computations too.

    A small file is made there and removed again, since permissions do not show a file system
    that is read-only or full. Of a process killed meanwhile the next writer removes it.
    """
    target = Path(path)
    if target.exists() and not target.is_file():
        kind = "a folder" if target.is_dir() else "no ordinary file"
        raise ValueError(f"cannot write {target}: it is {kind}.")
    folder = target.resolve().parent
    if not folder.is_dir():
        raise ValueError(f"cannot write {target}: there is no folder {folder}.")
    mark, suffix = f"{_mark(target)}{os.getpid()}-", target.suffix
    try:
        with tempfile.NamedTemporaryFile(dir=folder, prefix=mark, suffix=suffix) as trial:
            trial.write(bytes(_LEAST))
    except OSError as error:
        raise ValueError(
            f"cannot write {target}: no file can be made in {folder} ({error.strerror})."
        ) from None
