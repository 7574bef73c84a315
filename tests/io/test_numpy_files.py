""".npz and .npy: archives and headers that claim what they do not hold."""

import io
import tracemalloc
import zipfile

import numpy as np
import pytest

from jaxtat.io import load_scan
from jaxtat.io.frames import LazyFrames

DATA = np.random.default_rng(3).standard_normal((6, 9))


def npy(descr, shape, content, version=1):
    """A .npy file with any header, true or not."""
    header = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    length = len(header).to_bytes(2 * version, "little")
    return b"\x93NUMPY" + bytes([version, 0]) + length + header + content


def archive(path, method=zipfile.ZIP_DEFLATED, **members):
    with zipfile.ZipFile(path, "w", method) as file:
        for name, content in members.items():
            file.writestr(f"{name}.npy", content)
    return path


class Trap:
    """Tells when it is unpickled."""

    sprung = False

    def __init__(self):
        self.state = 1

    def __setstate__(self, state):
        Trap.sprung = True


@pytest.mark.parametrize("suffix", [".npz", ".npy"])
def test_objects_are_refused_without_unpickling(tmp_path, suffix):
    path, trap = tmp_path / f"a{suffix}", np.array([Trap(), None], dtype=object)
    if suffix == ".npz":
        np.savez(path, raw=trap)
    else:
        np.save(path, trap)
    with pytest.raises(ValueError, match="has dtype object, expected real numbers"):
        load_scan(path)
    assert not Trap.sprung
    np.load(path, allow_pickle=True)["raw" if suffix == ".npz" else ...]
    assert Trap.sprung, "the trap works"
    Trap.sprung = False


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", ["u2", ">i2", "f8"])
@pytest.mark.parametrize("shape", [(6, 9), (2, 3, 9)])
def test_npy_is_a_memory_map(tmp_path, order, dtype, shape):
    values = np.asarray(np.arange(54).reshape(shape), dtype, order=order)
    np.save(tmp_path / "a.npy", values)
    scan = load_scan(tmp_path / "a.npy")
    assert (scan.kind, dict(scan.known)) == ("pressure", {})
    assert scan.data.dtype == np.dtype(dtype).newbyteorder("=")
    assert np.array_equal(np.asarray(scan.data), values)
    if dtype != ">i2":
        assert isinstance(scan.data, np.memmap)
    elif len(shape) == 3:
        assert isinstance(scan.data, LazyFrames)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (npy("<f8", (10**6, 10**6), DATA.tobytes()), "claims 8000000000000 bytes .*, but the file"),
        (npy("<f8", (6, 10), DATA.tobytes()), "claims 480 bytes .*, but the file holds 432 for it"),
        (npy("<f8", (6, 8), DATA.tobytes()), "claims 384 bytes .*, but the file holds 432"),
        (npy("<f8", (-6, -9), DATA.tobytes()), "claims the shape"),
        (npy("<f8", (0, 9), b""), "claims 0 bytes"),
        (npy("<f8", (54,), DATA.tobytes()), "expected .detectors, samples."),
        (npy("<c16", (6, 9), 2 * DATA.tobytes()), "dtype complex128, expected real numbers"),
        (npy("<f16", (6, 9), 2 * DATA.tobytes()), "expected real numbers of 64 bits at most"),
        (npy("|O", (6, 9), DATA.tobytes()), "dtype object, expected real numbers"),
        (npy("<f8", (6, 9), DATA.tobytes(), version=3), r"has version \(3, 0\) of its format"),
        (b"\x93NUMPY\2\0\xff\xff\xff\x7f" + bytes(200), "too large for the memory"),
        (npy("<f8", "__import__('os')", DATA.tobytes()), "cannot read"),
        (npy("<f8", "(" * 900, DATA.tobytes()), "cannot read"),
        (npy("<f8", "(" + "1" * 900 + ")", DATA.tobytes()), "cannot read"),
        (npy("<f8", "(" + "9" * 9000 + ",)", DATA.tobytes()), "cannot read"),
        (npy("<u2" * 6, (6, 9), DATA.tobytes()), "cannot read"),
        (npy("<f8", (6, 9), DATA.tobytes()).replace(b"'shape'", b"'shabe'"), "cannot read"),
    ],
)
def test_false_headers_are_refused(tmp_path, content, message):
    (tmp_path / "a.npy").write_bytes(content)
    archive(tmp_path / "a.npz", raw=content)
    tracemalloc.start()
    with pytest.raises(ValueError, match=message) as refused:
        load_scan(tmp_path / "a.npy")
    assert len(str(refused.value)) <= 300
    with pytest.raises(ValueError, match=r"cannot read .*a.npz"):
        load_scan(tmp_path / "a.npz")
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


def test_an_archive_that_inflates_to_much_needs_leave(tmp_path):
    buffer = io.BytesIO()
    np.save(buffer, np.zeros((100, 50_000)))
    path = archive(tmp_path / "a.npz", raw=buffer.getvalue())
    assert path.stat().st_size < 1e5
    tracemalloc.start()
    with pytest.raises(ValueError, match=r"raw takes 40000000 bytes.*allow more"):
        load_scan(path, max_bytes=10**7)
    refused = tracemalloc.get_traced_memory()[1]
    assert load_scan(path, max_bytes=4 * 10**7).data.shape == (100, 50_000)
    allowed = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert refused < 1e6
    assert allowed < 4.2e7


def test_packing_that_numpy_does_not_do_is_refused(tmp_path):
    path = archive(tmp_path / "a.npz", zipfile.ZIP_LZMA, raw=npy("<f8", (6, 9), DATA.tobytes()))
    with pytest.raises(ValueError, match="compressed or encrypted as NumPy does not"):
        load_scan(path)


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_a_wrong_digit_is_told(tmp_path, method):
    path = archive(tmp_path / "a.npz", method, raw=npy("<f8", (6, 9), DATA.tobytes()))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(ValueError, match="cannot read"):
        load_scan(path)


def test_the_header_of_others_is_read(tmp_path):
    """In another order, with other quotes and without the last comma."""
    header = b'{"shape": (6,9), "fortran_order": False, "descr": "<f8"}\n'
    start = b"\x93NUMPY\1\0" + len(header).to_bytes(2, "little")
    (tmp_path / "a.npy").write_bytes(start + header + DATA.tobytes())
    assert np.array_equal(load_scan(tmp_path / "a.npy").data, DATA)


def test_a_sparse_array_larger_than_memory_is_refused_at_once(tmp_path):
    """A terabyte of which nothing is on the disk."""
    for shape in ((10**6, 131_072), (1, 10**6, 131_072)):
        start = npy("<f8", shape, b"")
        with (tmp_path / "a.npy").open("wb") as file:
            file.write(start)
            file.truncate(len(start) + 8 * 10**6 * 131_072)
        with pytest.raises(ValueError, match=r"the array takes 1048576000000 bytes.*allow more"):
            load_scan(tmp_path / "a.npy")
