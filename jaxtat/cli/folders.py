"""All scans of a folder: an image file for each, a summary as a table, and a sheet of pictures.

A scan whose image is there already, made from the same file with the same options, is not
reconstructed again: the image's settings hold the digest of what it is made from, and its row of
the summary. Files are written under temporary names, so that one that is there is whole.
"""

import argparse
import csv
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from tqdm import tqdm

from ..base.atomic import replacing
from ..base.messages import name_of, one_line, reason_of
from ..base.threads import one_blas_thread
from ..geometry import VisibilityWarning
from ..io import load_settings
from ..io.registered_formats import registered_reader
from ..scans import Choices, ScanImages, as_json
from ..steps import AccuracyWarning, Contradiction
from .commands import prepared
from .digest_of_inputs import made_from
from .folder_sheet import write_sheet
from .image_file import shares_of_fit, write_image
from .inputs import changed
from .worker_processes import by_processes

SUFFIXES = (".npz", ".npy", ".mat", ".h5", ".hdf5", ".msot")  # of `io.formats`
SUMMARY, SHEET = "summary.csv", "contact_sheet.png"
OFTEN = 5.0  # [s] between two summaries while images are made
_CHOSEN = ("sound_speed", "region_radius", "model")
COLUMNS = (
    "file",
    "image",
    *(f"{name}{what}" for name in _CHOSEN for what in ("", "_grade")),
    "units",
    "channels_left_out",
    "unexplained",
    "remaining",
    "seconds",
    "message",
)
_MARK = "of_folder"  # of the settings: what only an image of this command has


class Task(NamedTuple):
    """A scan to be reconstructed.

    Attributes:
        name: of the file, from its folder.
        options: of the command, for this scan and its image.
        made_from: digest of input and options.
    """

    name: str
    options: argparse.Namespace
    made_from: str


class Outcome(NamedTuple):
    """What became of a scan.

    Attributes:
        name: of the file.
        row: of the summary, by column; what is unknown is missing.
        contradicted: whether the record contradicts what is known about it.
    """

    name: str
    row: dict[str, Any]
    contradicted: bool = False


def reconstruct_folder(options: argparse.Namespace) -> None:
    """``jaxtat reconstruct FOLDER``.

    Raises:
        ValueError: without any scan, for a folder of other files to write to, and at the end if
            scans have no image.
    """
    start, out = time.perf_counter(), Path(options.out)
    names = scan_files(Path(options.file), out, options.impulse_response_file)
    _require_own(out)
    found: dict[str, Outcome] = {}
    tasks: list[Task] = []
    for name in names:
        task = _task(options, name)
        outcome = _earlier(task)
        found |= {name: outcome} if outcome else {}
        tasks += [] if outcome else [task]
    n_kept, written = len(found), start
    _write_summary(out, names, found)
    bar = tqdm(total=len(names), initial=n_kept, unit="scan", disable=options.quiet)
    try:
        with bar:
            for outcome in _outcomes(tasks, options.jobs or 1):
                found[outcome.name] = outcome
                bar.update()
                if time.perf_counter() - written > OFTEN:
                    _write_summary(out, names, found)
                    written = time.perf_counter()
    finally:
        _write_summary(out, names, found)
    _end(options, names, found, n_kept)


def scan_files(folder: Path, out: Path, response: str | None = None) -> list[str]:
    """Names of the scan files in a folder and those in it, but for the one that is written to.

    Args:
        response: file of an impulse response, which is no scan.

    Raises:
        ValueError: if there is none.
    """
    names, others = [], [Path(other).resolve() for other in (out, response) if other]
    for path in sorted(folder.rglob("*")):
        inner = path.relative_to(folder)
        hidden = any(part.startswith(".") for part in inner.parts)
        if hidden or not path.is_file() or any(map(path.resolve().is_relative_to, others)):
            continue
        if path.suffix.lower() in SUFFIXES or registered_reader(path) is not None:
            names.append(inner.as_posix())
    if not names:
        raise ValueError(f"{name_of(folder)} holds no scan: no file ends in {', '.join(SUFFIXES)}.")
    return names


def _require_own(out: Path) -> None:
    """Make the folder, or raise ValueError for one with files of others."""
    try:
        out.mkdir(exist_ok=True)
    except OSError as error:
        raise ValueError(
            f"cannot write {name_of(out)}: no folder can be made in "
            f"{name_of(out.resolve().parent)} ({error.strerror})."
        ) from None
    inside = [path.name for path in out.iterdir() if not path.name.startswith(".")]
    if inside and not _is_summary(out / SUMMARY):
        raise ValueError(
            f"cannot write to {name_of(out)}: it holds {name_of(inside[0])} and no {SUMMARY} of "
            "this command: name a new folder, or one that this command has made."
        )


def _is_summary(path: Path) -> bool:
    first = ",".join(COLUMNS[:2])
    return path.is_file() and path.read_bytes()[: len(first)] == first.encode()


def _task(options: argparse.Namespace, name: str) -> Task:
    file, image = str(Path(options.file) / name), str(Path(options.out) / f"{name}.h5")
    options = changed(options, file=file, out=image, quiet=True)
    return Task(name, options, made_from(options))


def _earlier(task: Task) -> Outcome | None:
    """The outcome of an image that is there; None if it has to be made."""
    image = Path(task.options.out)
    if not image.exists():
        return None
    try:
        mark = load_settings(image).get(_MARK)
        row = mark.get("row") if isinstance(mark, dict) else None
        if not isinstance(mark, dict) or not isinstance(row, dict) or row.get("file") != task.name:
            raise ValueError("the image there was not made of this scan by this command")
    except ValueError as error:
        before = f"cannot write {name_of(image)}: "
        return _failed(task, one_line(before, reason_of(error).rstrip("."), "; move it away."))
    if mark.get("made_from") != task.made_from:
        return None
    return Outcome(task.name, row, bool(mark.get("contradicted")))


def _outcomes(tasks: list[Task], jobs: int) -> Iterator[Outcome]:
    """Reconstruct scans, in this process or several others, in which programs stay compiled."""
    if jobs == 1 or not tasks:
        yield from map(reconstruct_one, tasks)
        return
    for task, outcome in by_processes(reconstruct_one, tasks, jobs, tasks[0].options):
        yield outcome or _failed(
            task, "its process was ended, perhaps for lack of memory: take fewer --jobs."
        )


def reconstruct_one(task: Task) -> Outcome:
    """The image of a scan, and its row; an error is the row's message."""
    start = time.perf_counter()
    with one_blas_thread(), warnings.catch_warnings(record=True) as noted:
        warnings.simplefilter("always", VisibilityWarning)
        warnings.simplefilter("always", AccuracyWarning)
        try:
            return _reconstructed(task, start, noted)
        except (ValueError, OSError, MemoryError) as error:
            return _failed(task, reason_of(error))
        except Exception as error:  # that of one scan is not that of the others
            sys.excepthook(type(error), error, error.__traceback__)
            return _failed(task, one_line(f"{type(error).__name__}: ", str(error)))


def _reconstructed(task: Task, start: float, noted: list[warnings.WarningMessage]) -> Outcome:
    Path(task.options.out).parent.mkdir(parents=True, exist_ok=True)
    scan, choices, plan, options = prepared(task.options, start, fits=True)
    outcome: list[Outcome] = []

    def marked(result: ScanImages) -> dict[str, Any]:
        contradicted = any(issubclass(one.category, Contradiction) for one in noted)
        row = _row(task, choices, result) | {
            "seconds": round(time.perf_counter() - start, 2),
            "message": " ".join(dict.fromkeys(str(one.message) for one in noted)),
        }
        outcome.append(Outcome(task.name, row, contradicted))
        return {_MARK: {"made_from": task.made_from, "contradicted": contradicted, "row": row}}

    write_image(options, scan, choices, plan, marked)
    return outcome[0]


def _row(task: Task, choices: Choices, result: ScanImages) -> dict[str, Any]:
    row: dict[str, Any] = {"file": task.name, "image": f"{task.name}.h5"}
    chosen = as_json(choices)["choices"]
    for name in _CHOSEN:
        if name in chosen:
            row |= {name: chosen[name]["value"], f"{name}_grade": chosen[name]["grade"]}
    row["units"] = "SI" if choices.units.length and choices.units.time else "of the file"
    row["channels_left_out"] = len(choices.left_out)
    row |= {name: round(share, 4) for name, share in shares_of_fit(result).items()}
    return row


def _failed(task: Task, message: str) -> Outcome:
    return Outcome(task.name, {"file": task.name, "message": message})


def _write_summary(out: Path, names: list[str], found: dict[str, Outcome]) -> None:
    """A row for each scan that was looked at, in the order of the files."""
    with replacing(out / SUMMARY) as new, new.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(found[name].row for name in names if name in found)


def _end(
    options: argparse.Namespace, names: list[str], found: dict[str, Outcome], n_kept: int
) -> None:
    """Show all images on a sheet, and say what is wrong."""
    out = Path(options.out)
    rows = [found[name].row for name in names]
    good = [row for row in rows if "image" in row]
    bad = [row for row in rows if "image" not in row]
    if good:
        write_sheet(out / SHEET, [(out / row["image"], row["file"]) for row in good])
    if not options.quiet:
        kept = f", {n_kept} of them from before" if n_kept else ""
        print(f"{len(good)} of {len(names)} images are in {out}{kept}; see {SUMMARY} and {SHEET}")
    for name in names:
        if found[name].contradicted:
            text = f"{name}: {found[name].row['message']}"
            warnings.warn(text, Contradiction, stacklevel=2)
    if bad:
        first = f"{len(bad)} of {len(names)} scans have no image, see {out / SUMMARY}; "
        raise ValueError(one_line(f"{first}{bad[0]['file']}: ", bad[0]["message"]))
