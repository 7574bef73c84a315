"""Stacks of data: the same images as one by one, from and into anything that takes slices."""

import h5py
import numpy as np
import pytest

from jaxtat import phantoms, reconstruct, reconstruct_stack


@pytest.fixture(scope="module")
def frames(arc_plan):
    bell = phantoms.Bells([[0.2, 0.1]], [0.6])
    g = np.asarray(bell.circular_integrals(arc_plan.curve, arc_plan.radii))
    return np.stack([(k + 1) * g for k in range(7)])


@pytest.mark.parametrize("batch_size", [3, 100])
def test_batches_change_nothing(arc_plan, frames, batch_size):
    images = reconstruct_stack(arc_plan, frames, batch_size=batch_size)
    assert np.allclose(images, reconstruct(arc_plan, frames), atol=1e-12)


def test_from_and_into_a_file(arc_plan, frames, tmp_path, capfd):
    with h5py.File(tmp_path / "stack.h5", "w") as file:
        data = file.create_dataset("g", data=frames)
        out = file.create_dataset("images", (7, 21, 21), dtype="f8")
        assert reconstruct_stack(arc_plan, data, out=out, batch_size=3, progress=True) is out
        assert np.allclose(out[:], reconstruct(arc_plan, frames), atol=1e-6)
    assert "7/7" in capfd.readouterr().err


def test_wrong_shapes_are_refused(arc_plan, frames):
    with pytest.raises(ValueError, match=r"frames have shape \(80, 21\), expected \(n, 80, 21\)"):
        reconstruct_stack(arc_plan, frames[0])
    with pytest.raises(ValueError, match=r"out has shape \(6, 21, 21\), expected \(7, 21, 21\)"):
        reconstruct_stack(arc_plan, frames, out=np.empty((6, 21, 21)))
    with pytest.raises(ValueError, match="batch_size is 0"):
        reconstruct_stack(arc_plan, frames, batch_size=0)
