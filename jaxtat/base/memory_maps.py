"""Compiled programs are dropped before they fill the memory maps that a process may have.

On Linux each program takes some dozens of maps, of which a process is granted 65530 by default
(``/proc/sys/vm/max_map_count``). With none left compilation fails. JAX keeps every program, so that
studies of many sizes, such as numbers of detectors or pixels, would end there after some hundred.
"""

import gc
import logging
from pathlib import Path

import jax

SHARE = 0.6  # of the maps granted, from which on programs are dropped: one size takes 0.02
_MAPS, _GRANTED = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")


def drop_programs_if_short_of_maps() -> bool:
    """Let JAX forget all programs if memory maps run short, with a line in the log.

    What is needed again is compiled again. Called where new sizes come in: when a setup is made.

    Returns:
        Whether it did.
    """
    try:
        used, granted = _MAPS.read_bytes().count(b"\n"), int(_GRANTED.read_text())
    except (OSError, ValueError):  # no Linux
        return False
    if used < SHARE * granted:
        return False
    jax.clear_caches()
    gc.collect()
    left = _MAPS.read_bytes().count(b"\n")
    logging.getLogger(__name__).info(
        "%d of %d memory maps were in use: compiled programs are dropped, %d are left.",
        used,
        granted,
        left,
    )
    return True
