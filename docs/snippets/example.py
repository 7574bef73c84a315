import jax

jax.config.update("jax_enable_x64", True)  # jaxtat computes in double precision
import jaxtat

curve = jaxtat.circular_arc(radius=1.3, cut=1.0, n_detectors=80)  # three quarters of a circle
region = jaxtat.disk(1.0)  # where the image is wanted
grid = jaxtat.ImageGrid(21)
setup = jaxtat.Setup(curve, region, grid)
phantom = jaxtat.phantoms.Bells(centers=[[0.1, 0.2]], radii=[0.7])
g = phantom.circular_integrals(curve, setup.radii)  # data (detectors, radii)
