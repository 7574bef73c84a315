"""One thread for the linear algebra library that XLA calls on processors.

XLA works in threads of its own. Where those of OpenBLAS, which factorizes its small matrices, come
on top, they wait for each other: on a busy machine that takes several times as long.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

from threadpoolctl import threadpool_limits


class _OneThread:
    """Sets the limit while any thread of the program is inside, and then what was before."""

    def __init__(self) -> None:
        self._lock, self._inside, self._limits = Lock(), 0, None

    @contextmanager
    def __call__(self) -> Iterator[None]:
        with self._lock:
            if self._inside == 0:
                self._limits = threadpool_limits(1, user_api="blas")
            self._inside += 1
        try:
            yield
        finally:
            with self._lock:
                self._inside -= 1
                if self._limits is not None and self._inside == 0:
                    self._limits.restore_original_limits()


one_blas_thread = _OneThread()
