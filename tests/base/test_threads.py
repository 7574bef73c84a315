"""OpenBLAS has one thread while anything computes, and then as many as before."""

from concurrent.futures import ThreadPoolExecutor
from threading import Event

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from jaxtat import build_plan, solve
from jaxtat.base.threads import one_blas_thread
from jaxtat.reconstruction import direct, plan


def blas_threads():
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


@pytest.fixture(autouse=True)
def two():
    with threadpool_limits(2, user_api="blas"):
        yield


def test_threads_of_the_program_may_overlap():
    """The first to come in leaves first, and the other does not end with its limit kept."""
    inside, ended = Event(), Event()

    def work():
        with one_blas_thread():
            inside.set()
            ended.wait(30)

    with ThreadPoolExecutor(1) as pool:
        with one_blas_thread(), one_blas_thread():
            assert blas_threads() == {1}
            other = pool.submit(work)
            inside.wait(30)
        ended.set()
        other.result()
    assert blas_threads() == {2}
    with one_blas_thread():
        assert blas_threads() == {1}


def test_an_error_inside_restores_them():
    with pytest.raises(ZeroDivisionError), one_blas_thread():
        raise ZeroDivisionError
    assert blas_threads() == {2}


def test_solutions_and_plans_take_one(arc, monkeypatch):
    seen = []

    def watched(work):
        def call(*arguments):
            seen.append(blas_threads())
            return work(*arguments)

        return call

    monkeypatch.setattr(direct, "images_of", watched(direct.images_of))
    monkeypatch.setitem(plan._BUILD, "cylindrical", watched(plan._BUILD["cylindrical"]))
    solve(arc, np.ones(arc.data_shape), 1e-3)
    build_plan(arc)
    assert seen == [{1}, {1}]
    assert blas_threads() == {2}
