"""Programs are dropped when memory maps run short."""

import logging

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxtat
from jaxtat.base import memory_maps


@pytest.fixture
def granted(monkeypatch, tmp_path):
    """Sets how many maps the system says it grants."""
    monkeypatch.setattr(memory_maps, "_GRANTED", tmp_path / "granted")
    return lambda number: (tmp_path / "granted").write_text(f"{number}\n")


@pytest.mark.skipif(not memory_maps._MAPS.exists(), reason="counted on Linux alone")
def test_programs_are_dropped_with_a_line_in_the_log(granted, caplog, programs_of):
    twice = jax.jit(lambda x: 2 * x)
    twice(jnp.ones(3))
    granted(10**9)
    with caplog.at_level(logging.INFO, logger="jaxtat"):
        assert not memory_maps.drop_programs_if_short_of_maps()
        assert not caplog.records and programs_of(lambda: twice(jnp.ones(3))) == []
        granted(10)
        assert memory_maps.drop_programs_if_short_of_maps()
    (record,) = caplog.records
    assert "of 10 memory maps were in use: compiled programs are dropped" in record.getMessage()
    assert programs_of(lambda: twice(jnp.ones(3)))


@pytest.mark.skipif(not memory_maps._MAPS.exists(), reason="counted on Linux alone")
def test_setups_go_on_when_programs_are_dropped(granted, arc):
    g = np.random.default_rng(0).standard_normal(arc.data_shape)
    before = jaxtat.reconstruct(arc, g, 1e-3)
    granted(10)
    again = jaxtat.Setup(arc.curve, arc.region, arc.grid, arc.radii)
    np.testing.assert_array_equal(jaxtat.reconstruct(again, g, 1e-3), before)


def test_nothing_is_dropped_where_maps_are_not_counted(monkeypatch, tmp_path):
    monkeypatch.setattr(memory_maps, "_MAPS", tmp_path / "none")
    assert not memory_maps.drop_programs_if_short_of_maps()
