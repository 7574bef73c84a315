"""Public data of others: downloaded when asked for, checked, never part of jaxtat.

Each set is known by the SHA-256 of its files. Copies in the folder that the environment variable
JAXTAT_DATA names are used where they are; the rest is downloaded into the user's cache (this needs
pip install 'jaxtat[io]'), if its authors publish it as a file. What they do not publish in that
form is listed too, with the page it comes from and how it was made. `sample_scan` writes a
simulated one, which needs nothing from anywhere.
"""

import hashlib
import os
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..base.optional_packages import optional
from .provenance import sha256
from .simulated_scan import sample_scan as sample_scan
from .zenodo import download_record

FOLDER = "JAXTAT_DATA"
_PATATO = "https://github.com/BohndiekLab/patato"
_ELLER_HOSKINS_KUNYANSKY = (
    "M. Eller, P. Hoskins and L. Kunyansky, Microlocally accurate solution of the inverse source "
    "problem of thermoacoustic tomography, Inverse Problems 36 (2020) 094004"
)
_FAST_HANKEL = "https://github.com/leonidak/Fast_Hankel-based_solver"
_RAW = "https://raw.githubusercontent.com/BohndiekLab/patato"
_SCAN = "tests/test_data_ithera/Scan_9"


@dataclass(frozen=True)
class DataFile:
    """One file: its place in the data folder, its checksum, and where it is published, if it is.

    The checksum is the SHA-256 of the bytes; of an .npz file, which every zlib compresses in a way
    of its own, that of the arrays (`checksum`).
    """

    path: str
    sha256: str
    url: str | None = None


@dataclass(frozen=True)
class DataSet:
    """Files that belong together, the first being the one to open.

    Attributes:
        name: as `fetch` takes it.
        what: what was measured or simulated, with geometry and units.
        licence, citation, page: whose it is.
        files: all of them.
        recipe: for a set that cannot be downloaded as it is: how its files were made.
        record: of Zenodo, for a set that is all of a record: a folder, whose files are not listed
            here. Zenodo gives their checksums, by which a download is checked.
    """

    name: str
    what: str
    licence: str
    citation: str
    page: str
    files: tuple[DataFile, ...]
    recipe: str = ""
    record: int | None = None

    def __str__(self) -> str:
        return f"{self.name}: {self.what}\nLicence: {self.licence}. {self.citation}. {self.page}"


def _made_of(measurements: str) -> str:
    return (
        f"It was made of simulations/{measurements} (pressure) and "
        "simulations/few_detectors/ground_truth.npy (truth) there: np.savez(path, "
        "pressure=np.load(...).astype('float32'), truth=np.load(...).astype('float32'))."
    )


DATA_SETS = {
    dataset.name: dataset
    for dataset in (
        DataSet(
            name="msot_scan9",
            what="measured cross-section of an animal, one frame at 700 nm: 256 detectors focused "
            "into the plane on 268.9 degrees of a circle of 40.5 mm, 2030 samples at 40 MHz, with "
            "the scanner's impulse response; metres and seconds. The speed of sound is not stored "
            "(1480 to 1520 m/s are plausible).",
            licence="MIT",
            citation="T. R. Else, J. Gröhl, L. Hacker and S. E. Bohndiek, PATATO: a Python "
            "photoacoustic tomography analysis toolkit, Journal of Open Source Software",
            page=_PATATO,
            files=(
                DataFile(
                    "msot_scan9_raw/Scan_9.msot",
                    "0532cf985977d4c4f7ce83bba7301f3bd5d709ba8bbe11231cc47e9d4be163dd",
                    f"{_RAW}/4a2ac0379d50ad2544cafb94145db419fc5c953d/{_SCAN}/Scan_9.msot",
                ),
                DataFile(
                    "msot_scan9_raw/Scan_9.bin",
                    "3aa8917b0fe23109af31f67342ee6235eb8c09788ab02ba79ac0dc888f574dd7",
                    f"{_RAW}/607704abed7256ea92bdfa08ead1905066a40c43/{_SCAN}/Scan_9.bin",
                ),
                DataFile(
                    "msot_scan9_raw/Scan_9.irf",
                    "07ceae4562cffb1dade727e96768f066fd0f595accb0c6476fc6545dea82a961",
                    f"{_RAW}/607704abed7256ea92bdfa08ead1905066a40c43/{_SCAN}/Scan_9.irf",
                ),
            ),
        ),
        DataSet(
            name="half_disk_three_quarter_arc",
            what="simulated 2-D waves of a phantom of disks in the upper half of the unit disk: "
            "pressure (769 times from 0 to 6 inclusive, 1024 detectors at the angles 2 pi k/1024 "
            "of the unit circle, those in a quarter of it missing), speed of sound 1; truth "
            "(257, 257) on [-1, 1]^2, rows along x2.",
            licence="MIT",
            citation=_ELLER_HOSKINS_KUNYANSKY,
            page=_FAST_HANKEL,
            files=(
                DataFile(
                    "half_disk_three_quarter_arc.npz",
                    "f93e2b78ea64097cc66b63f9479c656347501cd59a8b1ac39fb6113b2e85fe59",
                ),
            ),
            recipe=_made_of("partial_data/partial_measmnts.npy"),
        ),
        DataSet(
            name="full_circle_64_detectors",
            what="the same phantom seen by 64 detectors all around: pressure (769 times from 0 to "
            "6 inclusive, 64 detectors at the angles 2 pi k/64 of the unit circle), truth "
            "(257, 257).",
            licence="MIT",
            citation=_ELLER_HOSKINS_KUNYANSKY,
            page=_FAST_HANKEL,
            files=(
                DataFile(
                    "full_circle_64_detectors.npz",
                    "80ab2e62aa7da5f69648774fcf6da8cbf45bffc20d1122810279b5741ee9a7ad",
                ),
            ),
            recipe=_made_of("few_detectors/measurements_few.npy"),
        ),
        DataSet(
            name="ipasc_example",
            what="a file in the IPASC format with random values, for readers to be tried on: a "
            "linear array, three data dimensions.",
            licence="BSD-3-Clause",
            citation="J. Gröhl et al., The IPASC data format: a consensus data format for "
            "photoacoustic imaging, Photoacoustics 26 (2022) 100339",
            page="https://github.com/IPASC/PACFISH",
            files=(
                DataFile(
                    "ipasc_compatible_V1.hdf5",
                    "d8f17e15b7736329f17d92e2d5e6878abf4722124748e066d627d0e040f7de94",
                ),
            ),
            recipe="It is data/ipasc_compatible_V1.hdf5 in an early state of that repository "
            "(commit ac76e3375d071a34cb4c2f449d1d131159093a6b).",
        ),
        DataSet(
            name="digital_twins_2025",
            what="phantoms measured in an MSOT inVision and simulated alike, with the truth: "
            "folders calibration, testing and full_view of .npy files: p0 and images (300, 300) of "
            "32 mm, records (256, 2030), reconstructions by six methods.",
            licence="CC BY 4.0",
            citation="J. Gröhl et al., Digital twins enable full-reference quality assessment of "
            "photoacoustic image reconstructions, J. Acoust. Soc. Am. 158 (2025) 590-601",
            page="https://doi.org/10.5281/zenodo.15388429",
            files=(),
            record=15388429,
        ),
    )
}


def fetch(name: str, *, quiet: bool = False) -> Path:
    """The path of a data set's first file, after all its files have been found and checked.

    Files are looked for in the folder JAXTAT_DATA, then in the user's cache, then downloaded. Of a
    record of Zenodo it is the folder; archives in it are for you to unpack, and what is in
    JAXTAT_DATA under the set's name is taken as it is.

    Args:
        name: one of `DATA_SETS`.
        quiet: do not print what it is, its licence and whom to cite (on stderr).

    Raises:
        ValueError: for an unknown name, a file whose checksum is wrong, or without pooch.
        FileNotFoundError: for a file that is not published as such, with what to do.
        ConnectionError: if a download fails, with what to put where by hand.

    >>> sorted(DATA_SETS)[-1]
    'msot_scan9'
    >>> fetch("msot_scan9", quiet=True).name  # doctest: +SKIP
    'Scan_9.msot'
    """
    if name not in DATA_SETS:
        raise ValueError(f"there is no data set {name!r}, expected one of {', '.join(DATA_SETS)}.")
    dataset = DATA_SETS[name]
    if not quiet:
        print(dataset, file=sys.stderr)
    if dataset.record is not None:
        return _record(dataset, dataset.record)
    paths = [_local(file) for file in dataset.files]
    if None in paths:  # readers expect the files of a set in one folder
        paths = [_downloaded(dataset, file) for file in dataset.files]
    return Path(paths[0] or "")


def checksum(path: str | Path) -> str:
    """SHA-256 of a file; of an .npz file that of its arrays: names, types, shapes, values in order.

    Raises:
        ValueError: for an .npz file that is damaged.
    """
    if Path(path).suffix != ".npz":
        return sha256(path)
    digest = hashlib.sha256()
    try:
        with Path(path).open("rb") as handle, np.load(handle, allow_pickle=False) as file:
            for name in sorted(file.files):
                array = np.ascontiguousarray(file[name]).astype(file[name].dtype.newbyteorder("<"))
                digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
                digest.update(array.tobytes())
    except Exception as error:  # zipfile, zlib and numpy each raise their own for damage
        raise ValueError(f"cannot read {path}: damaged, or no .npz file ({error}).") from error
    return digest.hexdigest()


def _record(dataset: DataSet, number: int) -> Path:
    """Its folder in JAXTAT_DATA, or in the cache."""
    folder = os.environ.get(FOLDER)
    if folder and (path := Path(folder) / dataset.name).is_dir():
        return path
    path = Path(optional("pooch", "downloading data").os_cache("jaxtat")) / dataset.name
    download_record(number, path)
    return path


def _local(file: DataFile) -> Path | None:
    """The file in JAXTAT_DATA, if there; a wrong one is refused, not passed over."""
    folder = os.environ.get(FOLDER)
    if not folder or not (path := Path(folder) / file.path).is_file():
        return None
    if (own := checksum(path)) != file.sha256:
        raise ValueError(
            f"{path} is not the file it should be (SHA-256 {own}, expected {file.sha256}): "
            "replace or remove it."
        )
    return path


def _downloaded(dataset: DataSet, file: DataFile) -> Path:
    place = f"put it at {file.path} in a folder of yours and name the folder in {FOLDER}"
    if file.url is None:
        folder = os.environ.get(FOLDER)
        raise FileNotFoundError(
            f"{file.path} is not published as such, and {FOLDER} is "
            f"{f'{folder}, without it' if folder else 'not set'}. It comes from {dataset.page} "
            f"({dataset.licence}). {dataset.recipe} Then {place}. It is checked: SHA-256 "
            f"{file.sha256}{' of its arrays' if file.path.endswith('.npz') else ''}."
        )
    pooch = optional("pooch", "downloading data")
    folder, known = Path(pooch.os_cache("jaxtat")) / dataset.name, f"sha256:{file.sha256}"
    try:
        return Path(pooch.retrieve(file.url, known, Path(file.path).name, folder))
    except OSError as error:  # what requests raises is one
        raise ConnectionError(
            f"cannot download {file.url} ({error}). Without a network: get it elsewhere and "
            f"{place}."
        ) from error
