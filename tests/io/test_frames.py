"""Lazy frames: indexed as the array would be, and no more read than that."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxtat.io.frames import LazyFrames, in_native_order

DATA = np.random.default_rng(0).standard_normal((5, 4, 7))


def lazy():
    """Frames, and a list of the numbers that were read."""
    asked = []

    def read(numbers):
        asked.extend(numbers.tolist())
        return DATA[numbers]

    return LazyFrames(DATA.shape, DATA.dtype, read), asked


ends = st.none() | st.integers(-7, 7)
steps = st.builds(slice, ends, ends, st.none() | st.sampled_from([-2, -1, 1, 2]))
firsts = st.integers(-5, 4) | steps | st.lists(st.integers(-5, 4), max_size=3)
keys = st.one_of(
    firsts,
    st.tuples(firsts, st.integers(-4, 3) | steps),
    st.tuples(firsts, steps, steps),
    st.tuples(firsts, st.just(...), st.integers(0, 3)),
    st.tuples(st.just(...), steps),
    st.just(()) | st.just(...),
)


@given(keys)
@settings(deadline=None, max_examples=150)
def test_an_index_gives_what_the_array_gives(key):
    key = np.array(key, int) if isinstance(key, list) else key
    if isinstance(key, tuple) and key and isinstance(key[0], list):
        key = (np.array(key[0], int), *key[1:])
    frames, _ = lazy()
    wanted = DATA[key]
    found = frames[key]
    assert found.shape == wanted.shape
    assert np.array_equal(found, wanted)


def test_only_frames_asked_for_are_read():
    frames, asked = lazy()
    assert np.array_equal(frames.swapaxes(-2, -1)[3:], DATA[3:].swapaxes(1, 2))
    assert frames[1, 2, 3] == DATA[1, 2, 3]
    assert asked == [3, 4, 1]


def test_frames_as_a_whole():
    frames, _ = lazy()
    assert (len(frames), frames.ndim, frames.nbytes) == (5, 3, DATA.nbytes)
    assert np.array_equal(np.asarray(frames), DATA)
    assert np.asarray(frames, np.float32).dtype == np.float32


@pytest.mark.parametrize("key", [5, -6, [0, 5], (0, 9)])
def test_frames_that_are_not_there(key):
    with pytest.raises(IndexError):
        lazy()[0][key]


def test_frames_do_not_come_before_other_axes():
    with pytest.raises(ValueError, match="only the last two"):
        lazy()[0].swapaxes(0, 1)


def test_any_number_of_frames_can_be_claimed():
    frames = LazyFrames((10**15, 2, 2), np.dtype(float), lambda k: np.zeros((len(k), 2, 2)))
    assert frames.nbytes == 32 * 10**15
    assert frames[10**14 : 10**14 + 2].shape == (2, 2, 2)


@pytest.mark.parametrize("shape", [(5, 4, 7), (20, 7)])
def test_a_foreign_byte_order_becomes_the_native_one(shape):
    found = in_native_order(DATA.reshape(shape).astype(">f8"))
    assert found.dtype.isnative
    assert np.array_equal(np.asarray(found), DATA.reshape(shape))
