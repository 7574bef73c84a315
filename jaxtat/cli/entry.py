"""Entry: read the arguments, run the command, turn errors into one line and an exit code."""

import argparse
import gc
import os
import sys
import warnings
from collections.abc import Callable, Sequence

from ..base.messages import reason_of
from .option_checks import require_options
from .parser import build_parser

QUICK = "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
NO_READER, BAD_INPUT, CONTRADICTED, INTERRUPTED = 1, 2, 3, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run ``jaxtat`` with the given arguments (by default those of the process).

    Returns:
        0 after success, 2 for input that was refused (a line on stderr says why), 3 after success
        with a record that contradicts what is known about it, without ``--force``; 130 if
        interrupted; 1, without a word, if standard output was closed, as by ``head``.
    """
    options = build_parser().parse_args(arguments)
    try:
        require_options(options)
        contradicted = _run(options)
        sys.stdout.flush()  # a reader that is gone is noticed here, not when Python ends
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what is still held
        return NO_READER
    except (ValueError, OSError) as error:
        print(f"jaxtat: error: {reason_of(error)}", file=sys.stderr)
        return BAD_INPUT
    except (MemoryError, RuntimeError) as error:
        if not _is_of_memory(error):
            raise
        reason = str(error).splitlines()[0][:150]
        print(
            f"jaxtat: error: the memory does not suffice ({reason}): take fewer --pixels or "
            "--frames, or a machine with more.",
            file=sys.stderr,
        )
        return BAD_INPUT
    except KeyboardInterrupt:
        print("jaxtat: interrupted", file=sys.stderr)
        return INTERRUPTED
    return CONTRADICTED if contradicted and not options.force else 0


def _is_of_memory(error: Exception) -> bool:
    """Whether an error is a lack of memory, which libraries under JAX report by many names."""
    said = type(error).__name__ == "JaxRuntimeError" and str(error)
    return isinstance(error, MemoryError) or any(
        sign in (said or "") for sign in ("RESOURCE_EXHAUSTED", "YNNPACK", "memory")
    )


def _run(options: argparse.Namespace) -> bool:
    """The command itself; only now is JAX imported, for which help and refusals need not wait.

    Returns whether it noted that a record contradicts what is known about it.
    """
    begin(options.cache, options.no_cache)
    from ..base.threads import one_blas_thread
    from ..geometry import VisibilityWarning
    from ..steps import AccuracyWarning, Contradiction

    with one_blas_thread(), warnings.catch_warnings():
        warnings.simplefilter("always", VisibilityWarning)
        warnings.simplefilter("always", AccuracyWarning)
        shown: dict[str, type[Warning]] = {}
        warnings.showwarning = _notes(shown)
        options.run(options)
    return Contradiction in shown.values()


def begin(cache: str | None, no_cache: bool) -> None:
    """Import JAX with the settings of the command, once for a process.

    Args:
        cache: folder of compiled programs, see `keep_programs`.
        no_cache: whether none are kept.
    """
    if "jax" not in sys.modules:
        _compile_quickly()
        # imports and tracing make many objects, few of them garbage: looked for every 700, that
        # takes a tenth of the time of a first image
        gc.set_threshold(200_000, 20, 100)
    import jax

    from .cache import keep_programs

    jax.config.update("jax_enable_x64", True)  # the command is the program: its flag to set
    keep_programs(cache, off=no_cache)


def _compile_quickly() -> None:
    """Let XLA write programs in half the time, that are as fast: most of them run once.

    Newer versions lack the flag, and end a process that has it.
    """
    from jaxlib.version import __version_info__

    if __version_info__ < (0, 11):
        os.environ.setdefault("XLA_FLAGS", QUICK)


def _notes(shown: dict[str, type[Warning]]) -> Callable[..., None]:
    """A function that shows each warning once, as one line, and keeps its kind."""

    def show(message, category, filename, lineno, file=None, line=None) -> None:
        if str(message) not in shown:
            shown[str(message)] = category
            print(f"jaxtat: note: {message}", file=sys.stderr)

    return show
