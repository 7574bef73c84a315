"""What an image is made from, in one word: the same word, and it need not be made again."""

import argparse
import hashlib
import json
from pathlib import Path

from ..version import __version__

_BESIDE = (".bin", ".irf")  # an .msot file, where the numbers of its scan are
_DECIDES_NOTHING = (
    "run",
    "file",
    "out",
    "quiet",
    "force",
    "cache",
    "no_cache",
    "json",
    "jobs",
)


def made_from(options: argparse.Namespace) -> str:
    """A digest of the input files' names, sizes and times of change, of options, and the version.

    The files are not read: of a folder of large scans that would take as long as some images.

    Args:
        options: of the command, ``file`` one scan; the plan, the image to repeat and a response
            count as well.
    """
    response = getattr(options, "impulse_response_file", None)
    files = [Path(name) for name in (options.file, options.plan, options.repeat, response) if name]
    files += [
        beside
        for path in files
        if path.suffix == ".msot"
        for suffix in _BESIDE
        if (beside := path.with_suffix(suffix)).is_file()
    ]
    states = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in files]
    decide = {name: x for name, x in vars(options).items() if name not in _DECIDES_NOTHING}
    text = json.dumps([__version__, states, decide], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()
