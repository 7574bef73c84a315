"""Several processes for many scans; each compiles its programs once, and keeps them."""

import argparse
import multiprocessing
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import wait as wait_for
from typing import Any

from tqdm import tqdm

from .entry import begin


def by_processes(
    work: Callable[[Any], Any], tasks: Sequence[Any], jobs: int, options: argparse.Namespace
) -> Iterator[tuple[Any, Any]]:
    """Results of ``work(task)`` as they come, from ``jobs`` processes.

    No more tasks are given away than there are processes, so that those of a process that the
    system ends are known; the others go on in new ones.

    Args:
        work: a function of a module.
        tasks: that can be pickled.
        jobs: number of processes.
        options: of the command, with its folder of compiled programs.

    Yields:
        (task, result); None for a task whose process was ended, or another beside it.
    """
    waiting = deque(tasks)
    while waiting:
        with _pool(min(jobs, len(waiting)), options) as pool:
            yield from _until_broken(work, waiting, jobs, pool)


def _until_broken(
    work: Callable[[Any], Any], waiting: deque[Any], jobs: int, pool: ProcessPoolExecutor
) -> Iterator[tuple[Any, Any]]:
    running: dict[Future, Any] = {}
    broken = False
    while running or (waiting and not broken):
        while waiting and not broken and len(running) < jobs:
            try:
                future = pool.submit(work, waiting[0])
            except BrokenProcessPool:
                broken = True
            else:
                running[future] = waiting.popleft()
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            task, error = running.pop(future), future.exception()
            if isinstance(error, BrokenProcessPool):
                broken = True
                yield task, None
            else:
                yield task, future.result()


@contextmanager
def _pool(jobs: int, options: argparse.Namespace) -> Iterator[ProcessPoolExecutor]:
    """Processes that are begun anew, since JAX has threads, and end with this one."""
    before = multiprocessing.active_children()
    cores = max(1, (os.cpu_count() or 1) // jobs)
    with ProcessPoolExecutor(
        jobs,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_begin,
        initargs=(options.cache, options.no_cache, cores),
    ) as pool:
        try:
            yield pool
        except BaseException:  # Ctrl-C: what is being computed would be waited for
            for child in multiprocessing.active_children():
                if child not in before:
                    child.terminate()
            raise


def _begin(cache: str | None, no_cache: bool, cores: int) -> None:
    """In a new process: few threads for each of them, and the settings of the command."""
    os.environ["NPROC"] = str(cores)  # by which XLA takes so many threads
    # that of bars would be one for all processes, which Python misses when one of them is ended
    tqdm.set_lock(threading.RLock())
    threading.Thread(target=_end_with_parent, daemon=True).start()
    begin(cache, no_cache)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait_for([parent.sentinel])
        os._exit(1)
