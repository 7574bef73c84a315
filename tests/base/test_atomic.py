"""Files that are whole or untouched, whatever happens while they are written."""

import errno
import os
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from jaxtat.base.atomic import replacing, require_place


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_the_file_appears_at_the_end_and_nothing_else_stays(tmp_path):
    target = tmp_path / "image.png"
    with replacing(target) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".png"
        temporary.write_bytes(b"new")
        assert not target.exists()
    assert target.read_bytes() == b"new"
    assert names(tmp_path) == ["image.png"]


@pytest.mark.parametrize("error", [OSError("no space left"), KeyboardInterrupt()])
@pytest.mark.parametrize("there", [True, False])
def test_an_error_leaves_everything_as_it_was(tmp_path, error, there):
    target = tmp_path / "plan.h5"
    if there:
        target.write_bytes(b"old")
    before = names(tmp_path)
    with pytest.raises(type(error)), replacing(target) as temporary:
        temporary.write_bytes(b"half")
        raise error
    assert names(tmp_path) == before
    assert not there or target.read_bytes() == b"old"


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_files_get_the_users_own_mode(tmp_path, umask, mode):
    before = os.umask(umask)
    try:
        with replacing(tmp_path / "a.h5") as temporary:
            temporary.write_bytes(b"x")
        assert os.umask(umask) == umask
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.h5").stat().st_mode) == mode


def test_a_link_stays_and_its_file_is_replaced(tmp_path):
    (tmp_path / "disk").mkdir()
    real, link = tmp_path / "disk" / "plan.h5", tmp_path / "plan.h5"
    real.write_bytes(b"old")
    link.symlink_to(real)
    with replacing(link) as temporary:
        temporary.write_bytes(b"new")
    assert link.is_symlink()
    assert real.read_bytes() == b"new"
    assert names(tmp_path / "disk") == ["plan.h5"]


def test_places_that_cannot_be_files_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"a\.h5: there is no folder .*nowhere"):
        require_place(tmp_path / "nowhere" / "a.h5")
    with pytest.raises(ValueError, match="it is a folder"):
        require_place(tmp_path)
    with pytest.raises(ValueError, match="no ordinary file"):
        require_place(os.devnull)
    with pytest.raises(ValueError, match="no folder"), replacing(tmp_path / "nowhere" / "a.h5"):
        raise AssertionError("the block must not run")
    require_place(tmp_path / "a.h5")
    assert names(tmp_path) == []


@pytest.mark.parametrize("error", [errno.EACCES, errno.EROFS, errno.ENOSPC])
def test_a_folder_that_refuses_new_files_is_found_by_making_one(tmp_path, monkeypatch, error):
    """As root, and on file systems that are read-only or full, permissions say that all is well."""

    def refused(*arguments, **options):
        raise OSError(error, os.strerror(error), str(tmp_path / ".tmp1234.h5"))

    assert os.access(tmp_path, os.W_OK)
    monkeypatch.setattr(tempfile, "NamedTemporaryFile", refused)
    with pytest.raises(ValueError, match=rf"a\.h5: no file .* \({os.strerror(error)}\)") as caught:
        require_place(tmp_path / "a.h5")
    assert "tmp1234" not in str(caught.value)


@pytest.mark.skipif(os.name != "posix", reason="processes are not asked for elsewhere")
@pytest.mark.parametrize("asking", [False, True])
def test_what_a_killed_writer_left_is_removed_by_the_next(tmp_path, asking):
    """And nothing else: not what another writer has in hand, nor other files with such a name.

    Killed while it writes, or while it asks whether it can.
    """
    target = tmp_path / "image.png"
    writer = f"""
import os, tempfile
from pathlib import Path
from jaxtat.base.atomic import replacing
make, kill = tempfile.NamedTemporaryFile, lambda: os.kill(os.getpid(), 9)
if {asking}:
    tempfile.NamedTemporaryFile = lambda **where: (make(**where), kill())
with replacing(Path({str(target)!r})):
    kill()
"""
    done = subprocess.run([sys.executable, "-c", writer], cwd=Path(__file__).parents[2])
    assert done.returncode == -9
    (left,) = names(tmp_path)
    assert left.startswith(".image.png.")
    (tmp_path / ".image.png.notes").write_text("the user's own")
    with replacing(tmp_path / "other.png") as temporary:
        temporary.write_bytes(b"new")
    with replacing(target) as first:
        assert left not in names(tmp_path)
        with replacing(target) as second:
            assert first.exists()
            second.write_bytes(b"second")
        first.write_bytes(b"first")
    assert target.read_bytes() == b"first"
    assert names(tmp_path) == [".image.png.notes", "image.png", "other.png"]


def test_a_full_disk_is_said_of_the_file_itself_in_one_line(tmp_path):
    full = OSError(errno.ENOSPC, "No space left\non device", "/tmp/.a.h5.1")
    with (
        pytest.raises(OSError, match=r"cannot write .*a\.h5: No space left") as refused,
        replacing(tmp_path / "a.h5"),
    ):
        raise full
    assert refused.value.errno == errno.ENOSPC
    assert "\n" not in str(refused.value)


def test_a_full_disk_is_found_before_any_work(tmp_path):
    """By a limit on the size of files: the system refuses more, as a full disk does."""
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
    try:
        with pytest.raises(ValueError, match=r"image\.h5: no file can be made in .*too large"):
            require_place(tmp_path / "image.h5")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert names(tmp_path) == []
