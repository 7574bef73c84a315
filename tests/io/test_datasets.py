"""Data sets of others: from the folder, from a server on this machine, and refusals."""

import hashlib
import importlib
import json
import re
import socket
import threading
from dataclasses import replace
from functools import partial
from http.server import HTTPServer, SimpleHTTPRequestHandler
from pathlib import Path

import numpy as np
import pooch
import pytest

from jaxtat.io import datasets, load_scan
from jaxtat.io.datasets import DATA_SETS, DataFile, DataSet, checksum, fetch
from jaxtat.io.zenodo import download_record

CONTENT = {"scan/a.msot": b"geometry", "scan/a.bin": b"samples"}


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache, no folder of data."""
    monkeypatch.setattr(pooch, "os_cache", lambda project: tmp_path / "cache" / project)
    monkeypatch.delenv("JAXTAT_DATA", raising=False)
    return tmp_path / "cache" / "jaxtat" / "toy"


@pytest.fixture
def server(tmp_path):
    """A folder, what is asked of it, and its address."""
    folder = tmp_path / "served"
    for path, content in CONTENT.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(content)
    asked = []

    class Handler(SimpleHTTPRequestHandler):
        def log_message(self, format, *arguments):
            asked.append(self.path)

    found = HTTPServer(("127.0.0.1", 0), partial(Handler, directory=str(folder)))
    thread = threading.Thread(target=found.serve_forever, args=(0.01,))
    thread.start()
    yield folder, asked, f"http://127.0.0.1:{found.server_port}"
    found.shutdown()
    thread.join()
    found.server_close()


def publish(monkeypatch, address):
    files = tuple(
        DataFile(path, hashlib.sha256(content).hexdigest(), address and f"{address}/{path}")
        for path, content in CONTENT.items()
    )
    toy = DataSet(
        "toy", "a toy.", "MIT", "A. Maker, Toys", "https://example.org", files, "Make it."
    )
    monkeypatch.setitem(DATA_SETS, "toy", toy)


def test_files_are_downloaded_once_into_one_folder_and_the_licence_is_shown(
    server, cache, monkeypatch, capsys
):
    _, asked, address = server
    publish(monkeypatch, address)
    for _ in range(2):
        assert fetch("toy") == cache / "a.msot"
    assert {path.name: path.read_bytes() for path in cache.iterdir()} == {
        "a.msot": b"geometry",
        "a.bin": b"samples",
    }
    assert asked == ["/scan/a.msot", "/scan/a.bin"]
    shown = capsys.readouterr().err
    assert "toy: a toy.\nLicence: MIT. A. Maker, Toys. https://example.org" in shown
    fetch("toy", quiet=True)
    assert capsys.readouterr().err == ""


def test_what_is_not_the_published_file_is_refused_and_not_kept(server, cache, monkeypatch):
    folder, _, address = server
    publish(monkeypatch, address)
    (folder / "scan/a.bin").write_bytes(b"changed")
    with pytest.raises(ValueError, match="SHA256 hash of downloaded file"):
        fetch("toy", quiet=True)
    assert [path.name for path in cache.iterdir()] == ["a.msot"]


def test_without_a_network_it_says_what_to_put_where(cache, monkeypatch):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        publish(monkeypatch, f"http://127.0.0.1:{free.getsockname()[1]}")  # nobody listens
        with pytest.raises(ConnectionError, match=r"put it at scan/a\.msot in a folder of yours"):
            fetch("toy", quiet=True)
    assert not cache.exists() or not list(cache.iterdir())


def test_the_folder_comes_first_and_is_checked(server, cache, monkeypatch):
    folder, asked, address = server
    publish(monkeypatch, address)
    monkeypatch.setenv("JAXTAT_DATA", str(folder))
    assert fetch("toy", quiet=True) == folder / "scan/a.msot"
    (folder / "scan/a.bin").write_bytes(b"Samples")
    with pytest.raises(ValueError, match=r"a.bin is not the file it should be \(SHA-256"):
        fetch("toy", quiet=True)
    assert asked == []
    (folder / "scan/a.bin").unlink()
    with pytest.raises(ConnectionError, match="404"):  # then all of it, from the server
        fetch("toy", quiet=True)
    assert asked[0] == "/scan/a.msot"


def test_a_record_is_checked_by_the_checksums_of_its_own_listing(server, cache, monkeypatch):
    folder, _, address = server
    listing = folder / "api" / "records" / "7"
    listing.parent.mkdir(parents=True)
    entries = [
        {
            "key": Path(path).name,
            "checksum": "md5:" + hashlib.md5(content).hexdigest(),
            "links": {"self": f"{address}/{path}"},
        }
        for path, content in CONTENT.items()
    ]
    listing.write_text(json.dumps({"files": entries}))
    monkeypatch.setattr(datasets, "download_record", partial(download_record, site=address))
    toy = DataSet("toy", "a toy.", "CC BY 4.0", "A. Maker, Toys", "https://doi.org/7", (), record=7)
    monkeypatch.setitem(DATA_SETS, "toy", toy)
    assert fetch("toy", quiet=True) == cache
    assert {path.name: path.read_bytes() for path in cache.iterdir()} == {
        "a.msot": b"geometry",
        "a.bin": b"samples",
    }
    entries[0]["checksum"] = "md5:" + 32 * "0"
    listing.write_text(json.dumps({"files": entries}))
    with pytest.raises(ValueError, match="MD5 hash of downloaded file"):
        fetch("toy", quiet=True)
    listing.write_text("{}")
    with pytest.raises(ConnectionError, match=r"get its files from .*/records/7"):
        fetch("toy", quiet=True)
    (folder / "toy").mkdir()
    monkeypatch.setenv("JAXTAT_DATA", str(folder))
    assert fetch("toy", quiet=True) == folder / "toy"


def test_what_cannot_be_downloaded_is_described(cache, monkeypatch, tmp_path):
    publish(monkeypatch, None)
    wanted = "not published as such, and JAXTAT_DATA is not set. .*example.org .MIT.. Make it. Then"
    with pytest.raises(FileNotFoundError, match=wanted):
        fetch("toy")
    monkeypatch.setenv("JAXTAT_DATA", str(tmp_path))
    with pytest.raises(FileNotFoundError, match=r"JAXTAT_DATA is .*, without it"):
        fetch("toy")


def test_unknown_names_and_missing_packages_are_refused(cache, monkeypatch):
    with pytest.raises(ValueError, match="no data set 'msot', expected one of msot_scan9"):
        fetch("msot")

    def absent(module):
        raise ImportError(f"No module named {module!r}")

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(ValueError, match=r"needs pooch .*: pip install 'jaxtat\[io\]'"):
        fetch("msot_scan9")


def test_the_checksum_of_arrays_is_that_of_what_they_hold(tmp_path):
    """However they are compressed, ordered, or laid out in memory; any other value is another."""
    a, b = np.arange(6.0).reshape(2, 3), np.array([1, 2], ">i4")
    np.savez(tmp_path / "1.npz", a=a, b=b)
    np.savez_compressed(tmp_path / "2.npz", b=b.astype("<i4"), a=np.asfortranarray(a))
    assert checksum(tmp_path / "1.npz") == checksum(tmp_path / "2.npz")
    others = [{"a": a, "c": b}, {"a": a.reshape(3, 2), "b": b}, {"a": a + 1e-15, "b": b}]
    others += [{"a": a.astype("f4"), "b": b}, {"a": a}]
    for other in others:
        np.savez(tmp_path / "3.npz", **other)
        assert checksum(tmp_path / "3.npz") != checksum(tmp_path / "1.npz")
    (tmp_path / "4.npz").write_bytes((tmp_path / "1.npz").read_bytes()[:-20])
    with pytest.raises(ValueError, match="damaged"):
        checksum(tmp_path / "4.npz")


@pytest.mark.parametrize("name", DATA_SETS)
def test_every_set_says_whose_it_is_and_where_it_is(name):
    found = DATA_SETS[name]
    assert found.name == name
    assert found.licence in ("MIT", "BSD-3-Clause", "CC BY 4.0")
    assert found.page.startswith("https://github.com/" if found.files else "https://doi.org/")
    assert bool(found.files) != bool(found.record)
    for file in found.files:
        assert len(file.sha256) == 64
        # at a fixed commit, so that the file cannot change; or with a recipe
        commit = (file.url or "").removeprefix("https://raw.githubusercontent.com/").split("/")
        assert len(commit) > 3 and len(commit[2]) == 40 if file.url else found.recipe


def test_the_page_has_every_set_with_its_licence():
    page = (Path(__file__).resolve().parents[2] / "docs" / "data.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \| .* \| ([^|]*) \|$", page, re.M)
    assert dict(rows) == {name: found.licence for name, found in DATA_SETS.items()}


@pytest.mark.parametrize("name", DATA_SETS)
def test_the_copies_at_hand_are_the_published_ones(name, data_folder, monkeypatch, cache):
    monkeypatch.setenv("JAXTAT_DATA", str(data_folder))
    if DATA_SETS[name].record:
        pytest.skip(f"the checksums of {name} are Zenodo's, read when it is downloaded")
    if not all((data_folder / file.path).is_file() for file in DATA_SETS[name].files):
        pytest.skip(f"{name} is not in {data_folder} (set JAXTAT_DATA)")
    path = fetch(name, quiet=True)
    assert path.is_relative_to(data_folder)
    assert load_scan(path).kind == "pressure"
    files = tuple(replace(file, sha256="0" * 64) for file in DATA_SETS[name].files)
    monkeypatch.setitem(datasets.DATA_SETS, name, replace(DATA_SETS[name], files=files))
    with pytest.raises(ValueError, match="not the file it should be"):
        fetch(name, quiet=True)
