"""The arguments of every command, with their help."""

import argparse
import re
import sys
from collections.abc import Sequence
from decimal import Decimal
from difflib import get_close_matches
from typing import Any, NoReturn

from ..base.choice_table import (
    BODY_SHAPES,
    CONSTRAINTS,
    IMAGE,
    METHOD,
    OPTIONS,
    PLAIN,
    RECORD,
    REGION,
    option_of,
)
from ..base.option_values import FORMATS, IMAGE_SUFFIXES, OME_ZARR
from ..base.scanners import SCANNERS
from ..base.units import EXPONENTS, MILLIMETRES, time_of
from ..version import __version__
from . import commands

# two digits: -1e999999999 would be written out
_WITH_EXPONENT = re.compile(r"-(\d+\.?\d*|\.\d+)[eE][+-]?\d{1,2}")
_NEGATIVE_TIME = re.compile(rf"-[\d.].*({'|'.join(EXPONENTS)})")

_EXAMPLES = {
    "paper": """
  jaxtat paper --out out/paper
      repeat the numerical section of the paper: table, figures, metrics.json
""",
    "plan": """
  jaxtat plan --arc 1.3 0 500 --region-radius 1 --region-cut 0 --pixels 129 --out half.h5
      densities for a half circle of 500 detectors and a half disk (paper, geometry #2)
  jaxtat reconstruct data.npz --plan half.h5 --out image.png
      an image from circular integrals in data.npz
""",
    "reconstruct": """
  jaxtat reconstruct scan.hdf5 --out scan.png
      an image, everything chosen by the scan itself; options override
  jaxtat reconstruct scan.npz --model in-plane --sound-speed 1500 --region-radius 0.0146 \\
         --pixels 301 --band 1e5 7e6 --low-pass cosine --out scan.png
      the same with choices made by hand
  jaxtat reconstruct scan.hdf5 --direct --out scan.png
      the image by the formula, in one pass, instead of the one that fits the record
  jaxtat reconstruct scan.hdf5 --try sound_speed=1450:1600:10 --out sheet.png
      sixteen pictures beside each other, to choose by eye
  jaxtat reconstruct data.npz --plan half.h5 --out image.png
      with a plan, of `jaxtat plan`
  jaxtat reconstruct scans/ --out images/ --jobs 4
      all scans in a folder; run it again to go on where it was interrupted
  jaxtat reconstruct scan.msot --format patato --out scan.hdf5
      all wavelengths, for PATATO to unmix, in its own file; with --direct standard deviations too
""",
    "info": """
  jaxtat info scan.hdf5
      what is in a scan file, and what would be chosen for its reconstruction
  jaxtat info scan.hdf5 --json -
      the choices for other programs
""",
    "report": """
  jaxtat report scan.hdf5 --out report.html
      a page to look at: image, choices, what can be trusted and what not
""",
    "stream": """
  jaxtat stream scan.hdf5 --from frames/ --follow --out images/ --format png
      a picture of every frame that comes into a folder; geometry and choices are those of the scan
  acquisition | jaxtat stream scan.hdf5 --drop --out images.h5
      raw counts from a pipe into a file that can be read meanwhile
""",
    "view": """
  jaxtat view scan.hdf5
      the image in your browser, with controls for speed of sound, alpha, frame and others
  jaxtat view cap.h5
      of detectors around a volume: slices at sliders, maximum projections
""",
    "sample": """
  jaxtat sample scan.npz
      write a small simulated scan; `jaxtat reconstruct scan.npz --out scan.png` shows it
""",
}


class _Parser(argparse.ArgumentParser):
    """argparse takes -5e-4 and -2us for options, -0.0005 and " -2us" for values: it gets those.

    And a wrong word is one line: the usage above it would be the length of a screen.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.register("type", "time", _time)

    def parse_known_args(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[argparse.Namespace, list[str]]:
        words = sys.argv[1:] if args is None else args
        words = [_as_value(word) for word in words]
        options, unknown = super().parse_known_args(words, namespace)
        return options, [self._with_nearest(word) for word in unknown]

    def error(self, message: str) -> NoReturn:
        """Say it, and where all options are; exit code 2."""
        self.exit(2, f"{self.prog}: error: {message}; all options: {self.prog} --help\n")

    def _with_nearest(self, word: str) -> str:
        """A word that is no option, and in brackets the one that it may have been meant to be."""
        near = get_close_matches(word.partition("=")[0], self._option_string_actions, 1)
        return f"{word} (do you mean {near[0]}?)" if near and word.startswith("--") else word


def _as_value(word: str) -> str:
    """A negative number without its exponent, a negative time behind a space; others as they are.

    >>> _as_value("-5e-4"), _as_value("-2us"), _as_value("-e")
    ('-0.0005', ' -2us', '-e')
    """
    if _WITH_EXPONENT.fullmatch(word):
        return f"{Decimal(word):f}"
    return f" {word}" if _NEGATIVE_TIME.fullmatch(word) else word


def _time(text: str) -> float | str:
    """A number, or a time with its unit."""
    try:
        return time_of(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error).removesuffix(".")) from None


def build_parser() -> argparse.ArgumentParser:
    """The parser; ``options.run`` is the command's function."""
    parser = _Parser(
        prog="jaxtat",
        description="Thermo- and photoacoustic tomography with detectors on an open curve.",
        epilog="`jaxtat COMMAND --help` has the options of a command, and examples.",
    )
    parser.add_argument("--version", action="version", version=f"jaxtat {__version__}")
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_paper(subparsers)
    _add_plan(subparsers)
    _add_reconstruct(subparsers)
    _add_info(subparsers)
    _add_report(subparsers)
    _add_stream(subparsers)
    _add_view(subparsers)
    _add_sample(subparsers)
    return parser


def _command(subparsers, name: str, run, help: str) -> argparse.ArgumentParser:
    parser = subparsers.add_parser(
        name,
        help=help,
        description=help,
        epilog=f"examples:{_EXAMPLES[name]}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run, force=False)
    parser.add_argument("--quiet", action="store_true", help="no progress bar, no report")
    cache = parser.add_mutually_exclusive_group()
    cache.add_argument(
        "--cache",
        metavar="DIR",
        help="keep compiled programs here, for a quick start next time (default: in the user's "
        "folder for caches)",
    )
    cache.add_argument("--no-cache", action="store_true", help="keep no compiled programs")
    return parser


def _add_paper(subparsers) -> None:
    parser = _command(
        subparsers, "paper", commands.paper, "Repeat the numerical section of the paper."
    )
    parser.add_argument("--out", required=True, metavar="DIR", help="folder for all results")


def _add_plan(subparsers) -> None:
    parser = _command(subparsers, "plan", commands.plan, "Build a reconstruction plan and save it.")
    parser.add_argument("--out", required=True, metavar="FILE", help="HDF5 file to write")
    parser.add_argument(
        "--detectors-from",
        metavar="FILE",
        help="scan file (.npz, .h5) with detector positions (and radii)",
    )
    _add_geometry(parser)


def _add_reconstruct(subparsers) -> None:
    parser = _command(
        subparsers,
        "reconstruct",
        commands.reconstruct,
        "Reconstruct images from a scan, or from all scans of a folder.",
    )
    parser.add_argument(
        "file",
        metavar="FILE|FOLDER",
        help="a scan (formats: see jaxtat.io.load_scan), or a folder of scans",
    )
    parser.add_argument(
        "--out",
        required=True,
        metavar="IMAGE|FOLDER",
        help=f"image or volume to write: {', '.join(IMAGE_SUFFIXES)}, {OME_ZARR}; of a folder of "
        "scans one for .h5 files, a summary and a contact sheet",
    )
    parser.add_argument(
        "--errors",
        action="store_true",
        help="also how far each image may be off, in the .h5 file: of fitted ones by eight more "
        "fits on few pixels",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        metavar="N",
        help="processes that share the scans of a folder (default: 1)",
    )
    parser.add_argument(
        "--format",
        choices=tuple(FORMATS),
        help="of the image, where its suffix does not say enough: patato adds it to a scan's HDF5 "
        "file of PATATO, or makes one",
    )
    parser.add_argument(
        "--frames", metavar="SLICES", help="frames to reconstruct: 0:10 or 3:4,8:20:2"
    )
    parser.add_argument(
        "--try",
        dest="trial",
        metavar="NAME=VALUES",
        help="a sheet of pictures, one choice at several values and all others the same: "
        "sound_speed=1450:1600:10 or alpha=1e-3,1e-2",
    )
    _add_json(parser, "FILE", "also write what was chosen here, with reasons and grades")
    _add_unit_and_plan(parser)
    _add_choices(parser)
    _add_constraints(parser)


def _add_unit_and_plan(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--plan", metavar="FILE", help="use this plan instead of building one")
    _add_repeat_and_unit(parser)


def _add_repeat_and_unit(parser: argparse.ArgumentParser) -> None:
    _add_unit(parser)
    parser.add_argument(
        "--repeat", metavar="IMAGE", help="choose what was chosen for this .h5 image"
    )


def _add_unit(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--length-unit",
        choices=MILLIMETRES,
        help="in which positions and radii of the file are (default: told by their size); what is "
        "shown is in millimetres then",
    )


def _add_report(subparsers) -> None:
    parser = _command(
        subparsers, "report", commands.report, "A page about one image, with its diagnostics."
    )
    parser.add_argument("file", metavar="FILE", help="a scan (formats: see jaxtat.io.load_scan)")
    parser.add_argument("--out", required=True, metavar="PAGE", help=".html file to write")
    parser.add_argument(
        "--frame", type=int, default=0, metavar="N", help="of a scan of many (default: the first)"
    )
    parser.add_argument("--noise", type=float, metavar="SIGMA", help="of the circular integrals")
    parser.add_argument(
        "--uncertainty-pixels",
        type=int,
        metavar="N",
        help="standard deviations at N x N pixels (default 24, of large plans fewer), 0 for none",
    )
    _add_unit_and_plan(parser)
    _add_choices(parser)
    _add_constraints(parser)


def _add_info(subparsers) -> None:
    parser = _command(
        subparsers, "info", commands.info, "What is in a scan file, and what would be chosen."
    )
    parser.add_argument("file", metavar="FILE", help="a scan (formats: see jaxtat.io.load_scan)")
    _add_json(parser, "FILE|-", "write the choices, for programs, here or to standard output")
    _add_unit(parser)
    _add_choices(parser)


def _add_json(parser: argparse.ArgumentParser, metavar: str, what: str) -> None:
    parser.add_argument("--json", metavar=metavar, help=f"{what}, in SI units")


def _add_stream(subparsers) -> None:
    parser = _command(
        subparsers, "stream", commands.stream, "Images of raw frames as they come, until Ctrl-C."
    )
    parser.add_argument(
        "file", metavar="FILE", help="a scan of the same scanner, by which everything is chosen"
    )
    parser.add_argument(
        "--from",
        dest="source",
        default="-",
        metavar="SOURCE",
        help="frames, detectors x samples numbers each with nothing between them: a file, a folder "
        "of .npy files, or - for standard input (the default)",
    )
    parser.add_argument(
        "--type", metavar="TYPE", help="of the numbers: uint16, float32, ... (default: the scan's)"
    )
    parser.add_argument(
        "--follow", action="store_true", help="wait for more at the end of a file or folder"
    )
    parser.add_argument(
        "--drop",
        action="store_true",
        help="leave out the oldest of 64 waiting frames where there is no time for all",
    )
    parser.add_argument("--out", required=True, metavar="PLACE", help="a folder, or a new .h5 file")
    parser.add_argument(
        "--format", choices=("npy", "png"), help="of files in a folder (default: npy)"
    )
    _add_unit_and_plan(parser)
    _add_choices(parser)


def _add_view(subparsers) -> None:
    parser = _command(
        subparsers,
        "view",
        commands.view,
        "A scan in the browser, with sliders for its parameters, or of volumes for slices, until "
        "Ctrl-C.",
    )
    parser.add_argument("file", metavar="FILE", help="a scan (formats: see jaxtat.io.load_scan)")
    parser.add_argument(
        "--port", type=int, default=0, metavar="N", help="of 127.0.0.1 (default: any that is free)"
    )
    parser.add_argument(
        "--no-browser", action="store_true", help="print the address, but do not open it"
    )
    parser.add_argument(
        "--folder", default=".", metavar="DIR", help="for images that you keep (default: here)"
    )
    parser.add_argument("--frames", metavar="SLICES", help="frames to look at: 0:10 or 3:4,8:20:2")
    _add_repeat_and_unit(parser)
    parser.set_defaults(plan=None)
    _add_choices(parser)


def _add_sample(subparsers) -> None:
    parser = _command(
        subparsers, "sample", commands.sample, "Write a small simulated scan to try things on."
    )
    parser.add_argument("out", metavar="FILE", help=".npz file to write")


def _add_choices(parser: argparse.ArgumentParser) -> None:
    """Options for parameters that are otherwise chosen from the scan."""
    parser.add_argument(
        "--force",
        action="store_true",
        help="exit code 0 also where the record contradicts its geometry, times or units (else 3)",
    )
    _add_options(parser, PLAIN)
    data = parser.add_argument_group("pressure records (default: by the record)")
    times = data.add_mutually_exclusive_group()
    times.add_argument("--sampling-rate", type=float, metavar="F", help="samples at 0, 1/F, ...")
    times.add_argument("--duration", type="time", metavar="T", help="samples from 0 to T inclusive")
    data.add_argument(
        "--start-time",
        type="time",
        metavar="T",
        help="time of the first sample, if that is not 0, when the laser fires: 1.375us, -1e-6",
    )
    response = data.add_mutually_exclusive_group()
    response.add_argument(
        "--impulse-response",
        dest="impulse_response_file",
        metavar="FILE",
        help=".npy or .npz of what the elements record of a pulse, at the sampling rate, time 0 in "
        "the middle (default: that in the file)",
    )
    response.add_argument(
        "--element-band",
        type=float,
        nargs=2,
        metavar=("F", "WIDTH"),
        help="the same by a data sheet: centre frequency, and width at -6 dB over it, 0.6 of 60 %%",
    )
    _add_options(data, RECORD)
    speeds = data.add_mutually_exclusive_group()
    speeds.add_argument(
        "--two-speeds",
        action="store_true",
        default=None,
        help="estimate the body in water of another speed, a minute's work or a few; used if it "
        "explains clearly more (default where the water's speed or temperature is given alone, and "
        "in the plane where one speed leaves the start of the record open)",
    )
    speeds.add_argument(
        "--one-speed",
        dest="two_speeds",
        action="store_const",
        const=False,
        help="one speed of sound, of the body and the water alike",
    )
    data.add_argument(
        "--body-shape",
        choices=BODY_SHAPES,
        help="of a body that is estimated (default: disk, in space a ball); ellipse asks for "
        "--two-speeds and takes some minutes, and is used if it explains clearly more",
    )
    data.add_argument(
        "--water-temperature", type=float, metavar="T", help="in place of --water-speed [degrees C]"
    )
    _add_geometry(parser)


def _add_constraints(parser: argparse.ArgumentParser) -> None:
    _add_options(parser.add_argument_group("images with constraints"), CONSTRAINTS)


def _add_options(group, name: str) -> None:
    """The options of one group in the table of choices."""
    for choice in OPTIONS:
        if choice.group != name:
            continue
        if not choice.off:
            group.add_argument(option_of(choice.name), **choice.option)
            continue
        either = group.add_mutually_exclusive_group()
        either.add_argument(option_of(choice.name), **choice.option)
        either.add_argument(
            option_of(choice.off),
            dest=choice.name,
            action="store_const",
            const=False,
            help=choice.off_help,
        )


def _add_geometry(parser: argparse.ArgumentParser) -> None:
    where = parser.add_argument_group("detectors (default: positions in the file)")
    kind = where.add_mutually_exclusive_group()
    kind.add_argument(
        "--arc",
        type=float,
        nargs=3,
        metavar=("R", "CUT", "N"),
        help="N detectors on |z| = R, z_1 < CUT",
    )
    kind.add_argument(
        "--ring",
        type=float,
        nargs=2,
        metavar=("R", "N"),
        help="detector k at the angle 2 pi k / N on |z| = R",
    )
    kind.add_argument("--scanner", metavar="NAME", help=f"one of {', '.join(SCANNERS)}")
    where.add_argument(
        "--use",
        metavar="SLICES",
        help="detectors to use, good or bad: 904:1024,0:616 or 0:500:2; "
        "with a minus in front --use=-20:,0:80",
    )
    _add_options(
        parser.add_argument_group(
            "region of interest (default: where sound comes from; 3/4 of the arc for integrals)"
        ),
        REGION,
    )
    _add_options(parser.add_argument_group("image"), IMAGE)
    _add_method(parser)


def _add_method(parser: argparse.ArgumentParser) -> None:
    method = parser.add_argument_group("method")
    rule = method.add_mutually_exclusive_group()
    rule.add_argument("--K", type=float, help="norm bound (default: the paper's, 4.287)")
    rule.add_argument("--j-max", type=float, metavar="J", help="fixed number of singular values")
    rule.add_argument("--sigma-min", type=float, metavar="S", help="least singular value")
    _add_options(method, METHOD)
    engine = method.add_mutually_exclusive_group()
    engine.add_argument("--series", action="store_true", help="closed form, full circle only")
    engine.add_argument("--collocation", action="store_true", help="as in the paper, slower")
    method.add_argument("--single", action="store_true", help="densities in single precision")
