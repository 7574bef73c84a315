"""Errors in the options alone, reported before JAX is imported and the file is opened."""

import argparse
import math
import os
from collections.abc import Sequence
from pathlib import Path

from ..base.atomic import require_new, require_place
from ..base.choice_table import (
    NOT_NEGATIVE,
    NUMBERS,
    OF_CONSTRAINTS,
    OF_REGION,
    OF_TWO_SPEEDS,
    OFF,
    OPTIONS,
    POSITIVE,
    Choice,
    choice_named,
    option_of,
    require_pixels,
    words_of,
)
from ..base.messages import name_of, require_file
from ..base.option_values import (
    FORMATS,
    IMAGE_SUFFIXES,
    OME_ZARR,
    STREAM_SUFFIXES,
    WITH_ERRORS,
)
from ..base.scanners import scanner_named

MOST_TRIALS = 36  # images on a sheet
OF_PLANS = ("K", "j_max", "sigma_min", "series", "collocation", "single")
_MORE_BOUNDS = {
    **dict.fromkeys(("sampling_rate", "duration"), POSITIVE),
    **dict.fromkeys(("noise", "K", "j_max", "sigma_min"), NOT_NEGATIVE),
}
_BOUNDED = (*OPTIONS, *(Choice(name, float, bound=bound) for name, bound in _MORE_BOUNDS.items()))
_SUFFIXES = {"reconstruct": (*IMAGE_SUFFIXES, OME_ZARR), "report": (".html",)}


def require_options(options: argparse.Namespace) -> None:
    """Raise ValueError for options that are impossible, alone or together, for any data."""
    require_values(options)
    if _is_of_folder(options):
        _require_of_folder(options)
    elif is_given(options, "jobs"):
        raise ValueError("--jobs shares the scans of a folder, and this is a single file.")
    _require_together(options)
    suffixes = ("",) if _is_of_folder(options) else _SUFFIXES.get(options.run.__name__, ("",))
    if is_given(options, "format") and options.format in FORMATS:
        suffixes = FORMATS[options.format]
    if not getattr(options, "out", "").endswith(suffixes):
        raise ValueError(
            f"cannot write {options.out}: expected a name ending in {', '.join(suffixes)}."
        )
    if options.run.__name__ == "stream":
        _require_sink(options)
        _require_source(options)
    if options.cache is not None:
        _require_folder(options.cache)
    _require_files(options)


def require_values(options: argparse.Namespace) -> None:
    """Raise ValueError for a value that is impossible alone."""
    _require_numbers(options)
    _require_detectors(options)


def _require_files(options: argparse.Namespace) -> None:
    """Raise an error for files that cannot be read or written, before anything else is done."""
    into_folder = _is_of_folder(options) or options.run.__name__ in ("paper", "stream")
    if not into_folder and is_given(options, "out"):
        require_place(options.out)
    if is_given(options, "json") and options.json != "-":
        require_place(options.json)
        if is_given(options, "out") and Path(options.json) == Path(options.out):
            raise ValueError(f"--json and --out are {name_of(options.out)}: expected two files.")
    for name in ("file", "detectors_from", "repeat", "plan", "impulse_response_file"):
        if is_given(options, name) and not (name == "file" and _is_of_folder(options)):
            require_file(getattr(options, name))
    for name in ("out", "json"):
        if is_given(options, name) and not (name == "out" and is_given(options, "format")):
            _require_not_read(options, Path(getattr(options, name)))


def _require_not_read(options: argparse.Namespace, path: Path) -> None:
    """Raise ValueError for a file that the command reads: a record would be lost."""
    for name in ("file", "detectors_from", "plan", "impulse_response_file"):
        if path.exists() and is_given(options, name) and path.samefile(getattr(options, name)):
            raise ValueError(
                f"cannot write {name_of(path)}: it is read here, and would be lost: expected the "
                "name of another file."
            )


def _is_of_folder(options: argparse.Namespace) -> bool:
    """Whether the command is to reconstruct all scans of a folder."""
    return options.run.__name__ == "reconstruct" and Path(options.file).is_dir()


def _require_of_folder(options: argparse.Namespace) -> None:
    """Raise ValueError for options of a single scan, and places that are no folder."""
    for name in ("format", "trial", "json"):
        if is_given(options, name):
            option = "--try" if name == "trial" else option_of(name)
            raise ValueError(f"{option} is of a single scan, and {options.file} is a folder.")
    if is_given(options, "jobs") and options.jobs < 1:
        raise ValueError(f"--jobs {options.jobs}: expected 1 or more processes.")
    out = Path(options.out)
    if out.is_file() or (not out.exists() and out.name.endswith(_SUFFIXES["reconstruct"])):
        raise ValueError(
            f"{options.file} is a folder, whose images go into a folder, and {out} is none: "
            "expected --out FOLDER, or the file of one scan."
        )
    if not out.resolve().parent.is_dir():
        raise ValueError(f"cannot write {out}: there is no folder {out.resolve().parent}.")
    if Path(options.file).resolve().is_relative_to(out.resolve()):
        raise ValueError(f"{out} holds the scans: expected --out with another folder for images.")


def is_given(options: argparse.Namespace, name: str) -> bool:
    """Whether the option was named, with a value."""
    value = getattr(options, name, None)
    return value is not None and (value is not False or name in OFF)  # 0 is a value


def wants_plan(options: argparse.Namespace) -> bool:
    """Whether an option needs densities, and so a plan."""
    return any(is_given(options, name) for name in OF_PLANS)


def slices(use: str, option: str = "--use") -> list[slice]:
    """The slices of --use, or of --frames.

    >>> slices("904:1024,:616")
    [slice(904, 1024, None), slice(None, 616, None)]
    """
    parsed = []
    for text in use.split(","):
        try:
            bounds = [int(bound) if bound else None for bound in text.split(":")]
        except ValueError:
            bounds = []
        if not 2 <= len(bounds) <= 3 or bounds[2:] == [0]:
            raise ValueError(f"{option} {text}: expected slices such as 904:1024,0:616 or 0:500:2.")
        parsed.append(slice(*bounds))
    return parsed


def trial(text: str) -> tuple[str, Sequence[float]]:
    """The name and the values of --try.

    >>> trial("sound-speed=1480:1520:20")
    ('sound_speed', [1480.0, 1500.0, 1520.0])
    >>> trial("alpha=1e-4,1e-3")
    ('alpha', [0.0001, 0.001])
    """
    name, _, values = text.partition("=")
    name = name.replace("-", "_")
    if name not in NUMBERS:
        raise ValueError(f"--try {text}: expected NAME=VALUES, NAME one of {', '.join(NUMBERS)}.")
    expected = f"--try {text}: expected {name}=START:STOP:STEP or {name}=FIRST,SECOND,..."
    try:
        numbers = _steps(values) if ":" in values else [float(v) for v in values.split(",")]
    except ValueError:
        raise ValueError(f"{expected}.") from None
    if not 0 < len(numbers) <= MOST_TRIALS:
        raise ValueError(f"{expected} of 1 to {MOST_TRIALS} values.")
    for value in numbers:
        choice_named(name).require(value, f"--try {name}")
    if name == "pixels":
        for value in numbers:
            require_pixels(value, f"--try {name}")
        return name, [int(value) for value in numbers]
    return name, numbers


def _steps(text: str) -> list[float]:
    """START:STOP:STEP, the end included where a step meets it."""
    start, stop, step = (float(bound) for bound in text.split(":"))
    n = (stop - start) / step if step else math.nan
    if not 0 <= n < math.inf:
        return []
    return [start + k * step for k in range(min(int(n + 1e-6), MOST_TRIALS) + 1)]


def band(texts: list[str]) -> tuple[float, float] | str:
    """The values of --band: two numbers, or "none"."""
    if texts == ["none"]:
        return "none"
    try:
        low, high = (float(text) for text in texts)
    except ValueError:
        low = high = math.nan
    if not (math.isfinite(low) and math.isfinite(high)):
        raise ValueError(f"--band {' '.join(texts)}: expected LOW HIGH, or none.")
    return low, high


def _require_numbers(options: argparse.Namespace) -> None:
    for choice in _BOUNDED:
        choice.require(getattr(options, choice.name, None), option_of(choice.name))
    require_pixels(getattr(options, "pixels", None), "--pixels")
    if getattr(options, "band", None) is not None:
        band(options.band)


def _require_detectors(options: argparse.Namespace) -> None:
    for name in ("arc", "ring"):
        if is_given(options, name):
            radius, n = getattr(options, name)[0], getattr(options, name)[-1]
            if not radius > 0:
                raise ValueError(f"--{name}: the radius is {radius:g}, expected above zero.")
            if not (n >= 1 and n.is_integer() and n < 2**31):
                raise ValueError(
                    f"--{name}: the number of detectors is {n:g}, expected a whole one."
                )
    if is_given(options, "scanner"):
        scanner_named(options.scanner)
    if is_given(options, "use"):
        slices(options.use)
    if is_given(options, "frames"):
        slices(options.frames, "--frames")


def _require_together(options: argparse.Namespace) -> None:
    if is_given(options, "series") and any(
        is_given(options, name) for name in ("K", "j_max", "sigma_min")
    ):
        raise ValueError("--series is a closed form: --K, --j-max and --sigma-min do nothing.")
    if is_given(options, "errors"):
        _require_room_for_errors(options)
    if getattr(options, "json", None) == "-" and options.run.__name__ != "info":
        raise ValueError("--json -: the report is on standard output, expected a file.")
    if is_given(options, "trial"):
        _require_trial(options)
    if is_given(options, "repeat"):
        every = tuple(choice.name for choice in OPTIONS)
        decided = (*every, *OF_PLANS, *OF_TWO_SPEEDS, "length_unit")
        _refuse(options, decided, "repeat", "the earlier image")
    if is_given(options, "plan"):
        of_plan = (*OF_REGION, "max_frequency", "alpha", *OF_TWO_SPEEDS, *OF_PLANS)
        _refuse(options, of_plan, "plan", "the plan")
    if is_given(options, "plan") or wants_plan(options):
        _refuse_constraints(options)
    if wants_plan(options) and is_given(options, "alpha"):
        raise ValueError("--alpha is for a reconstruction without densities: leave out the others.")


def _refuse_constraints(options: argparse.Namespace) -> None:
    """Raise ValueError for constraints beside a plan; its images are direct, as --direct says."""
    for name in OF_CONSTRAINTS:
        value = getattr(options, name, None)
        if is_given(options, name) and (name, value) != ("model_based", False):
            option = words_of(name, value)[0]
            raise ValueError(f"{option} and a plan: images are fitted without one.")


def _require_room_for_errors(options: argparse.Namespace) -> None:
    """Raise ValueError for what has no errors, or no place for them."""
    if not (_is_of_folder(options) or options.out.endswith(WITH_ERRORS)):
        raise ValueError(f"--errors are kept in an .h5 image, and {options.out} is none.")
    for name in ("format", "plan", *OF_PLANS):
        if is_given(options, name):
            raise ValueError(
                f"{option_of(name)} and --errors: those are of images that are fitted, or made "
                "without a plan; `jaxtat report` has them of a plan."
            )


def _require_trial(options: argparse.Namespace) -> None:
    name, _ = trial(options.trial)
    for other in (name, "repeat", "plan", *OF_PLANS):
        if is_given(options, other):
            raise ValueError(f"{option_of(other)} and --try: every picture is chosen anew.")
    if not options.out.endswith(".png"):
        raise ValueError(f"cannot write {options.out}: a sheet of trials is a picture, .png.")


def _require_sink(options: argparse.Namespace) -> None:
    """Raise ValueError for a destination to which a stream cannot write."""
    path, folder = Path(options.out), Path(options.out).resolve().parent
    if not folder.is_dir():
        raise ValueError(f"cannot write {options.out}: there is no folder {folder}.")
    if path.suffix in STREAM_SUFFIXES:
        if options.format is not None:
            raise ValueError(
                f"--format {options.format} is of files in a folder, and {options.out} is one file "
                "of HDF5: leave it out, or give a folder."
            )
        require_new(path)
    elif not path.is_dir() and (path.exists() or path.suffix):
        raise ValueError(
            f"cannot write {options.out}: expected a folder, or a name ending in "
            f"{' or '.join(STREAM_SUFFIXES)}. The name of a new folder has no ending."
        )


def _require_source(options: argparse.Namespace) -> None:
    """Raise an error for a place where a stream's frames cannot come from."""
    path = Path(options.source)
    if options.source != "-" and not (path.is_file() or path.is_dir()):
        raise FileNotFoundError(f"there is no file or folder {path} to take frames from.")
    if options.type is not None:
        _require_real_type(options.type)


def _require_real_type(name: str) -> None:
    """Raise ValueError for what is no NumPy type of real numbers; only this waits for NumPy."""
    import numpy as np

    try:
        kind = np.dtype(name).kind
    except TypeError:
        kind = ""
    if kind not in ("u", "i", "f"):
        raise ValueError(f"--type {name}: expected a type of real numbers, such as uint16.")


def _refuse(options: argparse.Namespace, names: tuple[str, ...], by: str, what: str) -> None:
    for name in names:
        if is_given(options, name):
            option = words_of(name, getattr(options, name))[0].partition("=")[0]
            raise ValueError(f"{option} and --{by}: {what} has decided that.")


def _require_folder(cache: str) -> None:
    """Raise ValueError for an unusable cache folder; JAX would only warn, for each program."""
    folder = Path(cache)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(
            f"--cache {cache}: the folder cannot be made ({error.strerror})."
        ) from None
    if not os.access(folder, os.R_OK | os.W_OK | os.X_OK):
        raise ValueError(f"--cache {cache}: the folder may not be read and written.")
