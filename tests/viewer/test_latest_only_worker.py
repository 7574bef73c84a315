"""Of much that is wanted the latest is done."""

import threading

import jax.numpy as jnp

from jaxtat.viewer.latest_only_worker import LatestOnlyWorker


class Loop:
    """The page's thread: what is to be done there waits until `turn`."""

    def __init__(self):
        self.waiting, self.there = [], threading.Semaphore(0)

    def later(self, work):
        self.waiting.append(work)
        self.there.release()

    def turn(self):
        assert self.there.acquire(timeout=20)
        self.waiting.pop(0)()


def test_what_came_meanwhile_is_left_out_but_for_the_last_and_what_must_be():
    loop, shown, go = Loop(), [], threading.Event()
    latest = LatestOnlyWorker(loop.later)

    def show(found, error):
        shown.append(found or error)

    latest.want(lambda: go.wait(20) and "first", show)
    for number in range(5):
        latest.want(lambda number=number: f"number {number}", show)
    latest.must(lambda: "kept", show)
    go.set()
    for _ in range(3):
        loop.turn()
    assert shown == ["first", "kept", "number 4"]
    latest.close()
    latest.want(lambda: "nothing", show)
    assert not loop.waiting


def test_errors_are_lines_and_the_next_goes_on(capsys):
    loop, shown = Loop(), []
    latest = LatestOnlyWorker(loop.later)

    def fails(kind):
        raise kind("not\nso")

    for kind in (ValueError, ZeroDivisionError):
        latest.want(lambda kind=kind: fails(kind), lambda found, error: shown.append(error))
        loop.turn()
    assert shown == ["not so", "not so"]
    said = capsys.readouterr().err
    assert "ZeroDivisionError" in said and "ValueError" not in said
    latest.close()


def test_the_work_is_in_double_precision():
    loop, shown = Loop(), []
    latest = LatestOnlyWorker(loop.later)
    latest.want(lambda: jnp.zeros(1).dtype, lambda found, error: shown.append(found))
    loop.turn()
    assert shown == ["float64"]
    latest.close()
