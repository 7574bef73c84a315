"""Files that harm: whole ones of every kind that is read, and what is done to them."""

import io
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "io"))
sys.path.insert(0, str(Path(__file__).resolve().parent))
from hdf5_checksums import SIGNATURES, mended, structures  # noqa: E402
from scan_writers import write_everything, write_matlab73, write_msot, write_named  # noqa: E402

Rng = np.random.Generator
KINDS = ("npz", "npy", "matlab 5", "matlab 7.3", "hdf5", "ipasc", "patato", "msot", "image", "plan")
# what HDF5 begins its structures with
_OF_HDF5 = (b"TREE", b"SNOD", b"HEAP", b"GCOL", *SIGNATURES)
_SIGNATURES = (*_OF_HDF5, b"PK\1\2", b"PK\3\4", b"PK\5\6", b"\x93NUMPY")
_NUMBERS = (0, 1, 2, 3, 4, 7, 8, 255, 256, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**32,
            2**40, 2**62, 2**63 - 1, 2**63, 2**64 - 1)  # fmt: skip
_TEXTS = ("", "0", "-1", "1e308", "nan", "inf", "1e-320", "0x10", "None", "9" * 400, "1,5", "\x07",
          "2147483648", "9223372036854775808", "[" * 300, "<a>", "&amp;", "é" * 50)  # fmt: skip


class Case(NamedTuple):
    """One kind of file: whole ones (name: content, the first is read), and what is done to them."""

    name: str
    seeds: list[dict[str, bytes]]
    edits: list[Callable[[dict[str, bytes], Rng], None]]
    seal: Callable[[bytes], bytes] | None = None  # gives a changed file a digest that fits again
    changes: Sequence[Callable[[bytes, Rng, bytes], bytes]] | None = None  # by default all

    def write(self, folder: Path, rng: Rng) -> Path:
        """A changed file into an empty folder, and what belongs beside it."""
        for path in folder.iterdir():
            path.unlink()
        files = dict(self.seeds[rng.integers(len(self.seeds))])
        first = next(iter(files))
        if self.edits and rng.random() < 0.4:
            self.edits[rng.integers(len(self.edits))](files, rng)
        else:
            name = first if rng.random() < 0.8 else list(files)[rng.integers(len(files))]
            other = self.seeds[rng.integers(len(self.seeds))].get(name, b"")
            changes = _CHANGES if self.changes is None else self.changes
            whole = files[name]
            for _ in range(rng.integers(1, 4) if changes else 0):
                change = changes[rng.integers(len(changes))]
                files[name] = change(files[name], rng, other)
            files[name] = mended(files[name], whole)
        if self.seal is not None and rng.random() < 0.9:
            files[first] = self.seal(files[first])
        for name, content in files.items():
            (folder / name).write_bytes(content)
        return folder / first


def seeds_of(folder: Path, names: Sequence[str]) -> list[Case]:
    """Cases by name, whose whole files are made in that folder."""
    data = np.random.default_rng(0).integers(0, 2**16, (3, 5, 8), np.uint16)
    positions = np.random.default_rng(1).standard_normal((5, 3))
    paths = write_everything(folder, data, positions, 4e7)
    msot = write_msot(
        folder / "b.msot", data, positions, wavelengths=[700.0] * 3, places=[2, 0, 1],
        response=np.ones(6),
    )  # fmt: skip
    known = {"positions": positions, "fs": 4e7}
    archive = write_named(folder / "c.npz", pressure=data[0] / 7, times=np.arange(8.0))
    foreign, fortran = folder / "b.npy", folder / "c.npy"
    np.save(foreign, data.astype(">f4"))
    np.save(fortran, np.asfortranarray(data[0]))
    matrix = write_named(folder / "d.mat", pressure=data[0] / 7.0, t=np.arange(8.0), **known)
    with matrix.open("ab") as file:
        file.write(paths["matlab 5"].read_bytes()[128:])
    plain = folder / "uncompressed.mat"
    write_uncompressed(plain, raw=data[0], positions=positions)
    larger = np.random.default_rng(2).standard_normal((4, 50, 200))
    v73 = write_matlab73(folder / "e.mat", raw=larger, fs=4e7)

    def whole(*paths: Path) -> list[dict[str, bytes]]:
        return [
            {
                f"a{part.suffix}": part.read_bytes()
                for part in (path, path.with_suffix(".bin"), path.with_suffix(".irf"))
                if part.is_file() and (part is path or path.suffix == ".msot")
            }
            for path in paths
        ]

    hdf5_edits = [edited_hdf5, looped, changed_structure, changed_structure]

    def of_hdf5(name: str, *paths: Path) -> Case:
        """Each file as it is, and in the library's newest version, with its checksums."""
        newest = [in_newest_version(path) for path in paths]
        return Case(name, whole(*paths, *newest), hdf5_edits)

    cases = {
        "npz": lambda: Case("npz", whole(paths["npz"], archive), [repacked, bomb_archive]),
        "npy": lambda: Case("npy", whole(paths["npy"], foreign, fortran), [lying_header]),
        "matlab 5": lambda: Case(
            "matlab 5", whole(paths["matlab 5"], matrix, plain), [repacked_matrices]
        ),
        "matlab 7.3": lambda: of_hdf5("matlab 7.3", paths["matlab 7.3"], v73),
        "hdf5": lambda: Case("hdf5", whole(*hdf5_of_all_kinds(folder)), hdf5_edits),
        "ipasc": lambda: of_hdf5("ipasc", paths["ipasc"], foreign_ipasc(folder)),
        "patato": lambda: of_hdf5("patato", paths["patato"]),
        "msot": lambda: Case("msot", whole(paths["msot"], msot), [edited_xml, bomb_xml]),
        "image": lambda: of_hdf5("image", *sorted(folder.glob("image *"))),
        "plan": lambda: Case("plan", whole(*sorted(folder.glob("plan *"))), hdf5_edits, sealed),
    }
    if {"image", "plan"} & set(names):
        written_by_jaxtat(folder)
    return [cases[name]() for name in names]


# whole files


def hdf5_of_all_kinds(folder: Path) -> list[Path]:
    """Every index of pieces that the library has, every layout, few and many names."""
    data = np.random.default_rng(3).standard_normal((6, 12, 20))
    checked = {"compression": "gzip", "shuffle": True, "fletcher32": True}
    ways = (
        {},
        {"chunks": (1, 12, 20), **checked},
        {"chunks": (2, 5, 7), **checked},
        {"chunks": (1, 6, 10), "fletcher32": True},
        {"chunks": (6, 12, 20), "compression": "gzip"},
        {"chunks": (1, 6, 10), "maxshape": (None, 12, 20), "compression": "gzip"},
        {"chunks": (1, 6, 10), "maxshape": (None, None, 20), **checked},
        {"chunks": (1, 12, 20), "maxshape": (6, 12, 20)},
    )
    paths = []
    for libver in ("earliest", "latest"):
        for number, options in enumerate(ways):
            paths.append(folder / f"{libver}{number}.h5")
            with h5py.File(paths[-1], "w", libver=libver) as file:
                file.create_dataset("raw", data=data, **options)
                file["detectors"] = data[0, :, :3]
                file["fs"] = 4e7
                file["comment"] = "a text of variable length"
                file["raw"].attrs["unit"] = "Pa"
                for k in range(20 * (number % 2)):  # many names are indexed in another way
                    file.create_group(f"more{k}")
    return paths


def in_newest_version(path: Path) -> Path:
    """A copy with all structures of version 2, and attributes enough to be indexed."""
    copy = path.with_name(f"newest {path.name}")
    with h5py.File(path) as old, h5py.File(copy, "w", libver="latest") as new:
        for name in old:
            old.copy(name, new)
        new.attrs.update(old.attrs)
        for k in range(12):
            new.attrs[f"further {k}"] = k
    return copy


def foreign_ipasc(folder: Path) -> Path:
    """With texts of variable length and packed data, as others write it."""
    path = folder / "foreign.hdf5"
    with h5py.File(path, "w") as file:
        series = np.arange(6 * 10 * 2 * 3.0).reshape(6, 10, 2, 3)
        file.create_dataset("binary_time_series_data", data=series, compression="gzip")
        meta = file.create_group("meta_data")
        meta["ad_sampling_rate"], meta["speed_of_sound"] = 4e7, 1540.0
        meta["uuid"], meta["scanning_method"] = "a-b-c", "handheld"
        meta["acquisition_wavelengths"] = np.array([7e-7, 8e-7])
        file["meta_data_device/general/unique_identifier"] = "device of others"
        for k in range(6):
            file[f"meta_data_device/detectors/d_{k}/detector_position"] = np.arange(3.0) + k
    return path


def written_by_jaxtat(folder: Path) -> None:
    """Images and plans, by a process of its own: children of one that has computed cannot."""
    program = f"""
import warnings; warnings.simplefilter("ignore")
import jax; jax.config.update("jax_enable_x64", True)
import numpy as np
from jaxtat import *
from jaxtat.io import save_image, save_plan
region, grid = disk(0.8, n_boundary=48), ImageGrid(5)
for name, arc, method in (("h", circular_arc(1.3, 1.0, 16), "cylindrical"),
                          ("s", circular_arc(1.3, 1.3, 16), "series")):
    radii = data_radii(arc, region, 0.5)
    setup = Setup(arc, region, grid, radii, max_frequency=5, n_directions=4)
    plan = build_plan(setup, method=method)
    save_plan(plan, {str(folder)!r} + f"/plan {{name}}.h5")
for name, shape in (("one", (5, 5)), ("many", (3, 5, 5))):
    settings = {{"alpha": 0.1, "use": list(range(80 * len(shape) - 160)), "file": "scan.npz"}}
    save_image({str(folder)!r} + f"/image {{name}}.h5", np.ones(shape), grid, region, settings)
"""
    subprocess.run([sys.executable, "-c", program], check=True, cwd=ROOT)


def sealed(content: bytes) -> bytes:
    """A plan with the digest that fits: damage is not found by it then."""
    from hashlib import blake2b

    start, space, _ = content.partition(b"\n")[0].rpartition(b" ")
    line = start + space + blake2b(content[512:]).hexdigest().encode() + b"\n"
    return line + content[len(line) :]


def write_uncompressed(path: Path, **arrays: np.ndarray) -> None:
    import scipy.io

    scipy.io.savemat(path, arrays)


# changes of bytes: what they are given, numbers at random, and another file of the kind


def _flip(content: bytes, rng: Rng, other: bytes) -> bytes:
    changed = bytearray(content or b"\0")
    for _ in range(rng.integers(1, 5)):
        changed[rng.integers(len(changed))] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _cut(content: bytes, rng: Rng, other: bytes) -> bytes:
    return content[: rng.integers(len(content) + 1)]


def _lie(content: bytes, rng: Rng, other: bytes) -> bytes:
    """A number that means much or nothing, often in a header."""
    marks = [at for mark in _SIGNATURES if (at := content.find(mark)) >= 0]
    changed, width = bytearray(content), int(rng.choice([1, 2, 4, 8]))
    at = int(rng.integers(max(1, len(content))))
    if marks and rng.random() < 0.7:
        mark = content[(start := marks[rng.integers(len(marks))]) :][:4]
        places = [start]
        while (start := content.find(mark, start + 1)) >= 0 and len(places) < 50:
            places.append(start)
        at = places[rng.integers(len(places))] + int(rng.integers(4, 100))
    value = (*_NUMBERS, len(content), at, int(rng.integers(2**16)))[rng.integers(len(_NUMBERS) + 3)]
    changed[at : at + width] = value.to_bytes(9, "little")[:width]
    return bytes(changed)


def _splice(content: bytes, rng: Rng, other: bytes) -> bytes:
    """Part of it left out, doubled, blank, or of another file."""
    a, b = sorted(rng.integers(len(content) + 1, size=2).tolist())
    b = min(b, a + int(rng.integers(1, 600)))
    parts = (b"", 2 * content[a:b], bytes(b - a), other[a:b], rng.bytes(b - a))
    return content[:a] + parts[rng.integers(len(parts))] + content[b:]


_CHANGES = (_flip, _flip, _lie, _lie, _lie, _cut, _splice)


# edits that know the format


def looped(files: dict[str, bytes], rng: Rng) -> None:
    """An address in an HDF5 file becomes that of another structure, or of the same."""
    name, content = next(iter(files.items()))
    base = max(0, content.find(b"\x89HDF"))
    places = []
    for mark in _OF_HDF5:
        at = -1
        while (at := content.find(mark, at + 1)) >= 0:
            places.append(at - base)
    places += [96, 800]
    targets = [
        at
        for place in set(places)
        for at in _all(content, place.to_bytes(8, "little"))
        if place > 0
    ]
    if targets:
        at = targets[rng.integers(len(targets))]
        new = places[rng.integers(len(places))].to_bytes(8, "little")
        files[name] = mended(content[:at] + new + content[at + 8 :], content)


def changed_structure(files: dict[str, bytes], rng: Rng) -> None:
    """A few bytes of one structure of version 2, whose checksum is mended; else `looped`."""
    name, content = next(iter(files.items()))
    places = structures(content)
    if not places:
        return looped(files, rng)
    start, stop, _ = places[rng.integers(len(places))]
    changed = bytearray(content)
    for _ in range(rng.integers(1, 4)):
        values = (0, 1, 2, 127, 128, 255, int(rng.integers(256)))
        changed[rng.integers(start + 4, stop)] = values[rng.integers(len(values))]
    files[name] = mended(bytes(changed), content)


def _all(content: bytes, part: bytes) -> list[int]:
    places, at = [], -1
    while (at := content.find(part, at + 1)) >= 0 and len(places) < 100:
        places.append(at)
    return places


def edited_hdf5(files: dict[str, bytes], rng: Rng) -> None:
    """Links, loops, other types, other filters, bombs and short pieces, by the library itself."""
    name, content = next(iter(files.items()))
    buffer = io.BytesIO(content)
    block = max(0, content.find(b"\x89HDF"))
    try:
        with h5py.File(buffer, "r+") as file:
            for _ in range(rng.integers(1, 4)):
                _edit(file, rng)
    except (OSError, RuntimeError, ValueError, KeyError, TypeError):
        pass  # what cannot be done is left out
    changed = buffer.getvalue()
    files[name] = content[:block] + changed[block:]


def _edit(file: h5py.File, rng: Rng) -> None:
    places = ["/"]
    file.visit(places.append)  # ends where links lead round in circles
    place = places[rng.integers(len(places))]
    item, other = file[place], places[rng.integers(len(places))]
    group = item if isinstance(item, h5py.Group) else item.parent
    name = (list(group) or ["raw"])[rng.integers(len(group) or 1)]
    if rng.random() < 0.3:
        _edit_mark(item, rng)
        return
    if isinstance(item, h5py.Dataset) and item.chunks and rng.random() < 0.5:
        origin = tuple(
            int(rng.integers(n)) // c * c for n, c in zip(item.shape, item.chunks, strict=True)
        )
        pieces = (b"", b"\1", b"abc", b"abcd", zlib.compress(bytes(10**5)), rng.bytes(50))
        mask = int(rng.integers(4)) if rng.random() < 0.3 else 0
        item.id.write_direct_chunk(origin, pieces[rng.integers(len(pieces))], filter_mask=mask)
        return
    if name in group:
        shape = group[name].shape if isinstance(group[name], h5py.Dataset) else (3, 4)
        if shape is not None and np.prod(shape, dtype=float) > 10**6:  # a bomb put there before
            shape = (3, 4)
        del group[name]
    else:
        shape = (3, 4)
    way = rng.integers(16)
    if way == 0:
        group[name] = h5py.SoftLink(f"/{other}")
    elif way == 1:
        group[name] = h5py.ExternalLink("a.h5", f"/{other}")
    elif way == 2:
        group[name] = file[other]  # a hard link, to itself, above or beside
    elif way == 3:
        group[name] = file
    elif way == 4:
        group.create_dataset(name, data=["a", "b" * 100], dtype=h5py.string_dtype())
    elif way == 5:
        group.create_dataset(name, shape or (2,), dtype=h5py.ref_dtype)
    elif way == 6:
        group.create_dataset(name, (2,), dtype=h5py.vlen_dtype(float))
    elif way == 7:
        group.create_dataset(name, (2**40, 2**10), "f8", chunks=(1, 64), compression="gzip")
    elif way == 8:
        zeros = np.zeros(shape or (2,))
        group.create_dataset(name, data=zeros, chunks=True if shape else None, compression="lzf")
    elif way == 9:
        group[name] = h5py.Empty("f8")
    elif way == 10:
        types = ("f4", "i8", "u1", "?", "c16", "S5", ">f8", "f2", "i1")
        group.create_dataset(name, shape, types[rng.integers(len(types))], fillvalue=None)
    elif way == 11:
        group.create_dataset(name, data=np.zeros(shape, [("a", "f8"), ("b", "i4")]))
    elif way == 12:
        group.create_dataset(
            name, data=np.zeros((100, 1000)), chunks=(100, 1000), compression="gzip"
        )
    elif way == 13:
        layout = h5py.VirtualLayout((4, 4), "f8")
        layout[...] = h5py.VirtualSource(".", other, (4, 4))
        group.create_virtual_dataset(name, layout)
    elif way == 14:
        group.create_dataset(name, (4, 4), "f8", external=[("a.h5", 0, 128)])
    else:
        group.create_group(name)


def _edit_mark(item: h5py.Group | h5py.Dataset, rng: Rng) -> None:
    names = list(item.attrs) or ["kind"]
    name = names[rng.integers(len(names))]
    values = (1, -1, 2**60, 0.5, np.nan, True, "text", np.bytes_("NormBound"), h5py.Empty("f8"),
              np.zeros(9), np.zeros((2, 2)), np.bytes_("ReconstructionPlan"), ["a", "b"],
              np.array([5, 5]), np.array([-5, 5]), np.array([5.0, 5.0]), 1 + 2j)  # fmt: skip
    del item.attrs[name]
    if rng.random() < 0.9:
        item.attrs[name] = values[rng.integers(len(values))]


def lying_header(files: dict[str, bytes], rng: Rng) -> None:
    """A .npy file whose header says something else."""
    name, content = next(iter(files.items()))
    body = content[10 + int.from_bytes(content[8:10], "little") :]
    files[name] = npy(rng, body)


def npy(rng: Rng, body: bytes) -> bytes:
    types = ("<f8", "<u2", ">i4", "|O", "<c16", "<f16", "|S9999999", "<U7", "|V4", "f8,f8", "O",
             "<M8[ns]", "<f3", "<u2" * 500, "(99999,99999)f8", "a5")  # fmt: skip
    shapes = ("(3, 5, 8)", "(-3, -40)", "(10**9, 10**9)", "(99999999999, 99999999999)", "()",
              "(1,)", "(0, 5)", "(3.0, 40.0)", "[3, 40]", "None", "(" * 900, "9" * 3000,
              "(" + "9" * 900 + ",)", "(3, 40) + (" * 50, "'a' * 10**9", "-" * 5000 + "1",
              "(True, 120)", f"({'1, ' * 60})", "(120L,)", "__import__('os')")  # fmt: skip
    fields = (
        f"'descr': {types[rng.integers(len(types))]!r}",
        f"'fortran_order': {('True', 'False', '7', 'None')[rng.integers(4)]}",
        f"'shape': {shapes[rng.integers(len(shapes))]}",
    )
    header = "{" + ", ".join(fields[: rng.integers(2, 4)]) + ", }\n"
    if rng.random() < 0.2:
        header = header.ljust(int(rng.choice([64, 9000, 70_000])))
    version = int(rng.integers(1, 4))
    width = 2 if version == 1 else 4
    claimed = len(header) if rng.random() < 0.8 else _NUMBERS[rng.integers(len(_NUMBERS))]
    length = (claimed % 256**width).to_bytes(width, "little")
    return b"\x93NUMPY" + bytes([version, 0]) + length + header.encode() + body


def repacked(files: dict[str, bytes], rng: Rng) -> None:
    """Members of an archive changed, with checksums that fit."""
    name, content = next(iter(files.items()))
    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(buffer, "w") as new:
        chosen = old.namelist()[rng.integers(len(old.namelist()))]
        for member in old.namelist():
            inner = old.read(member)
            if member == chosen:
                change = _CHANGES[rng.integers(len(_CHANGES))]
                inner = npy(rng, inner[128:]) if rng.random() < 0.5 else change(inner, rng, b"")
            method = int(rng.choice([0, 8, 8, 12, 14], p=[0.3, 0.3, 0.3, 0.05, 0.05]))
            new.writestr(member, inner, method)
            if rng.random() < 0.05:
                new.writestr(f"../{member}", inner, method)
    files[name] = buffer.getvalue()


def bomb_archive(files: dict[str, bytes], rng: Rng) -> None:
    """Few bytes that become many."""
    buffer = io.BytesIO()
    header = io.BytesIO()
    rows = int(rng.choice([10, 1000], p=[0.9, 0.1]))
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (rows, 1000)}
    )
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as new:
        new.writestr("raw.npy", header.getvalue() + bytes(8 * 1000 * int(rng.choice([rows, 10]))))
    files[next(iter(files))] = buffer.getvalue()


def repacked_matrices(files: dict[str, bytes], rng: Rng) -> None:
    """Elements of a MATLAB file changed inside, with checksums that fit."""
    name, content = next(iter(files.items()))
    changed, at = content[:128], 128
    while at + 8 <= len(content):
        kind, size = struct.unpack_from("<II", content, at)
        inner = content[at + 8 : at + 8 + size]
        inner = zlib.decompress(inner) if kind == 15 else content[at : at + 8 + size]
        if rng.random() < 0.5:
            inner = _CHANGES[rng.integers(len(_CHANGES))](inner, rng, inner)
        if rng.random() < 0.05:
            inner = inner[:8] + bytes(10**5) if rng.random() < 0.5 else inner * 20
        packed = zlib.compress(inner)
        changed += struct.pack("<II", 15, len(packed)) + packed
        at += 8 + size
    files[name] = changed


def edited_xml(files: dict[str, bytes], rng: Rng) -> None:
    """Numbers and names in a scanner's XML replaced."""
    name = next(iter(files))
    text = files[name].decode(errors="replace")
    for _ in range(rng.integers(1, 4)):
        starts = [at for at, sign in enumerate(text) if sign in '>"']
        if not starts:
            return
        at = starts[rng.integers(len(starts))] + 1
        end = min((e for sign in '<"' if (e := text.find(sign, at)) >= 0), default=at)
        text = text[:at] + _TEXTS[rng.integers(len(_TEXTS))] + text[end:]
    files[name] = text.encode()


def bomb_xml(files: dict[str, bytes], rng: Rng) -> None:
    """Entities within entities, elements within elements, or many."""
    name, content = next(iter(files.items()))
    laughs = "".join(
        f'<!ENTITY e{k} "{f"&e{k - 1};" * 10 if k else "ha"}">' for k in range(int(rng.integers(9)))
    )
    n = int(rng.choice([10, 1000, 50_000], p=[0.5, 0.48, 0.02]))
    head, _, rest = content.decode(errors="replace").partition("?>")
    ways = (
        f"{head}?><!DOCTYPE DataModelMsotProject [{laughs}]>{rest}",
        f"{head}?>{'<a>' * n}{rest}{'</a>' * n}",
        f"{head}?>{rest.replace('<ScanNode>', '<ScanNode>' + '<x/>' * n)}",
        f"{head}?>{rest.replace('<ScanNode>', '<ScanNode ' + ' '.join(f'a{k}=`1`' for k in range(n // 10)).replace('`', chr(34)) + '>')}",  # noqa: E501
        f"{head}?>{rest.replace('<Name>a scan', '<Name>' + 'a' * n)}",
    )
    files[name] = ways[rng.integers(len(ways))].encode()
