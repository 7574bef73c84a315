"""One thread for the linear algebra library that XLA calls on processors.

XLA works in threads of its own. Where those of OpenBLAS, which factorizes its small matrices, come
on top, they wait for each other: on a busy machine that takes several times as long.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

from threadpoolctl import threadpool_limits

_LIMITED = Lock()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit the threads, and restore the earlier limit at the end.

    It is one for the whole process: where another thread of the program, or a block around this
    one, has set it, that one ends it too.
    """
    if not _LIMITED.acquire(blocking=False):
        yield
        return
    try:
        with threadpool_limits(1, user_api="blas"):
            yield
    finally:
        _LIMITED.release()
