"""How a benchmark is measured: first call apart, median of the rest, error, peak memory."""

import ctypes
import gc
import re
import sys
import time
from pathlib import Path

import jax
import numpy as np
import pytest

jax.config.update("jax_enable_x64", True)
ROUNDS_WITHIN, LONG = 15.0, 20.0  # s


def _given_back() -> None:
    """Memory that the C library keeps goes back to Linux: else it counts at the next peak."""
    if sys.platform == "linux":
        ctypes.CDLL(None).malloc_trim(0)


@pytest.fixture
def measure(benchmark):
    """Measure ``work()``: ``error`` of its result, ``n`` pixels per axis, ``images`` at once.

    ``compiles``, if given, is called first in its stead: a cheaper call of the same programs.
    What takes milliseconds is done 40 times: the first few pay for caches and threads that wake.
    What takes longer is done as often as 15 s allow, 7 times at most; what takes 20 s with its
    compilation is done once more.
    """

    def run(work, *, n: int, images: int = 1, error=None, rounds: int | None = None, compiles=None):
        jax.clear_caches()
        gc.collect()
        _given_back()
        Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew
        start = time.perf_counter()
        jax.block_until_ready((compiles or work)())
        first = time.perf_counter() - start
        if first > LONG and compiles is None:
            rounds = 1
        elif rounds is None:
            start = time.perf_counter()
            jax.block_until_ready(work())
            once = time.perf_counter() - start
            rounds = 40 if once < 0.05 else int(np.clip(ROUNDS_WITHIN / once, 1, 7))
        result = benchmark.pedantic(lambda: jax.block_until_ready(work()), rounds=rounds)
        median = benchmark.stats.stats.median
        peak = re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())
        benchmark.extra_info.update(
            n=n,
            images=images,
            compile_s=max(first - (0.0 if compiles else median), 0.0),
            median_s=median / images,
            peak_mb=int(peak.group(1)) / 1024 if peak else float("nan"),
            max_error=float(np.max(error(result))) if error else float("nan"),
        )
        return result

    return run
