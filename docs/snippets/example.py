import jax

jax.config.update("jax_enable_x64", True)  # jaxtat computes in double precision, and asks for it
import jaxtat

curve = jaxtat.circular_arc(radius=1.3, cut=1.0, n_detectors=80)  # three quarters of a circle
region = jaxtat.disk(1.0)  # a whole disk
grid = jaxtat.ImageGrid(21)
radii = jaxtat.data_radii(curve, region, step=grid.spacing[0])
phantom = jaxtat.phantoms.Bells(centers=[[0.1, 0.2]], radii=[0.7])
g = phantom.circular_integrals(curve, radii)  # (detectors, radii)
