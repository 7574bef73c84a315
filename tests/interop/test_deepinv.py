"""DeepInverse judges: the adjoint, the proximal map, gradients, and one of its denoisers."""

import numpy as np
import pytest

from jaxtat import phantoms, reconstruct

deepinv = pytest.importorskip("deepinv", reason="DeepInverse is not installed: make test-deepinv")
torch = pytest.importorskip("torch")


@pytest.fixture(scope="module")
def physics(arc):
    from jaxtat.interop.deepinv import TomographyPhysics

    return TomographyPhysics(arc, 1e-6)


@pytest.fixture(scope="module")
def image(arc):
    bells = phantoms.Bells([[0.1, 0.2], [-0.4, -0.1]], [0.5, 0.4])
    return torch.tensor(np.asarray(bells.image(arc.grid)))[None, None]


def noise(shape, seed):
    return torch.tensor(np.random.default_rng(seed).standard_normal(shape))


def test_it_finds_the_adjoint_exact(physics, image):
    assert float(physics.adjointness_test(image)) < 1e-12
    assert float(physics.adjointness_test(image.float(), num_samples=2)) < 1e-5


def test_the_direct_reconstruction_is_the_dagger(arc):
    """With phantom, alpha and bound of test_linear_operators.py."""
    from jaxtat.interop.deepinv import TomographyPhysics

    physics = TomographyPhysics(arc, 1e-8)
    bell = phantoms.Bells([[0.1, 0.2]], [0.6]).image(arc.grid)
    image = torch.tensor(np.asarray(bell))[None, None]
    y = physics.A(image)
    assert y.shape == (1, 1, *arc.data_shape)
    found = physics.A_dagger(y)
    inside = torch.tensor(np.asarray(arc.region.contains(arc.grid.points)))
    direct = torch.tensor(np.asarray(reconstruct(arc, y[0, 0].numpy(), 1e-8)))
    assert torch.allclose(found[0, 0], torch.where(inside, direct, 0.0), atol=1e-10)
    assert torch.linalg.norm(found - image) < 0.01 * torch.linalg.norm(image)


def test_the_proximal_map_is_that_of_its_definition(physics, image):
    z, y, gamma = noise(image.shape, 0), physics.A(image), 0.3
    x = physics.prox_l2(z, y, gamma)
    slope = gamma * physics.A_adjoint(physics.A(x) - y) + x - z
    assert torch.linalg.norm(slope) < 1e-6 * torch.linalg.norm(z)
    theirs = deepinv.physics.LinearPhysics.prox_l2(
        physics, z, y, gamma, solver="CG", max_iter=300, tol=1e-10
    )
    assert torch.allclose(x, theirs, atol=1e-6)


def test_gradients_go_across(physics, image):
    """Against central differences along a random direction, in every argument."""
    y, z = physics.A(image), noise(image.shape, 1)
    weight, gamma = noise(image.shape, 2), torch.tensor(0.3, dtype=torch.float64)
    seen = noise(y.shape, 3)
    cases = (
        (lambda x: (physics.A(x) * seen).sum(), (image,)),
        (lambda y: (physics.A_adjoint(y) * weight).sum(), (y,)),
        (lambda y: (physics.A_dagger(y) * weight).sum(), (y,)),
        (lambda z, y, gamma: (physics.prox_l2(z, y, gamma) * weight).sum(), (z, y, gamma)),
    )
    for function, at in cases:
        at = [x.clone().requires_grad_() for x in at]
        slopes = torch.autograd.grad(function(*at), at)
        along = [noise(x.shape, 4) for x in at]
        ends = [
            function(*(x.detach() + h * d for x, d in zip(at, along, strict=True)))
            for h in (1e-4, -1e-4)
        ]
        wanted = float(ends[0] - ends[1]) / 2e-4
        got = float(sum((s * d).sum() for s, d in zip(slopes, along, strict=True)))
        assert got == pytest.approx(wanted, rel=1e-5)


def test_one_of_its_denoisers_beats_the_direct_image(physics, image, arc):
    """Proximal gradient steps with total variation, from few noisy data."""
    torch.manual_seed(0)
    clean = physics.A(image)
    y = clean + 0.05 * clean.abs().max() * noise(clean.shape, 5)
    denoise = deepinv.models.TVDenoiser(n_it_max=50)
    x = physics.A_dagger(y)
    direct = float(torch.linalg.norm(x - image))
    for _ in range(10):
        x = denoise(physics.prox_l2(x, y, 0.5), 0.02)
    assert float(torch.linalg.norm(x - image)) < 0.7 * direct
