"""Writing files so that a reader never sees half of one."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_LEAST = 4096  # bytes for which there must be room


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A temporary path beside ``path`` that takes its place when the block ends without error.

    The temporary name keeps the suffix, since some writers choose the format by it. Of a symbolic
    link the file it points to is replaced.

    Raises:
        ValueError: for a place where no file can be written, see `require_place`.

    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "note.txt"
    >>> with replacing(target) as temporary:
    ...     _ = temporary.write_text("done")
    >>> target.read_text(), len(list(target.parent.iterdir()))
    ('done', 1)
    """
    require_place(path)
    target = Path(path).resolve()
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=".", suffix=target.suffix)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)  # mkstemp's own mode is for private files
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


def require_place(path: str | Path) -> None:
    """Raise ValueError if ``path`` cannot be a file to write: asked before hours of work too.

    A small file is made there and removed again, since permissions do not tell of a file system
    that is read-only or full.
    """
    target = Path(path)
    if target.exists() and not target.is_file():
        kind = "a folder" if target.is_dir() else "no ordinary file"
        raise ValueError(f"cannot write {target}: it is {kind}.")
    folder = target.resolve().parent
    if not folder.is_dir():
        raise ValueError(f"cannot write {target}: there is no folder {folder}.")
    try:
        with tempfile.NamedTemporaryFile(dir=folder, prefix=".", suffix=target.suffix) as trial:
            trial.write(bytes(_LEAST))
    except OSError as error:
        raise ValueError(
            f"cannot write {target}: no file can be made in {folder} ({error.strerror})."
        ) from None
