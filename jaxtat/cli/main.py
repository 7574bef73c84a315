"""Entry: read the arguments, run the command, turn errors into one line and an exit code."""

import sys
import warnings
from collections.abc import Callable, Sequence

import jax
from threadpoolctl import threadpool_limits

from ..geometry import VisibilityWarning
from ..problem import AccuracyWarning
from .parser import build_parser

BAD_INPUT, INTERRUPTED = 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run ``jaxtat`` with the given arguments (by default those of the process).

    Returns:
        0 after success, 2 for input that was refused (a line on stderr says why), 130 if
        interrupted.
    """
    options = build_parser().parse_args(arguments)
    jax.config.update("jax_enable_x64", True)  # the command is the program: its flag to set
    if options.cache:
        jax.config.update("jax_compilation_cache_dir", options.cache)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
    # small matrices: threads of the linear algebra library only get in the way of XLA's
    with threadpool_limits(1, user_api="blas"), warnings.catch_warnings():
        warnings.simplefilter("always", VisibilityWarning)
        warnings.simplefilter("always", AccuracyWarning)
        warnings.showwarning = _notes()
        try:
            options.run(options)
        except (ValueError, OSError) as error:
            print(f"jaxtat: error: {' '.join(str(error).split())}", file=sys.stderr)
            return BAD_INPUT
        except KeyboardInterrupt:
            print("jaxtat: interrupted", file=sys.stderr)
            return INTERRUPTED
    return 0


def _notes() -> Callable[..., None]:
    """Shows each warning once, as a line."""
    shown: set[str] = set()

    def show(message, category, filename, lineno, file=None, line=None) -> None:
        if str(message) not in shown:
            shown.add(str(message))
            print(f"jaxtat: note: {message}", file=sys.stderr)

    return show
