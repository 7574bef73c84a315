"""Values of options, in a module that imports nothing: so `--help` is quick."""

MODELS = ("2d", "in-plane")  # of sound, see `pressure`
INVERSIONS = ("fourier", "fbp")  # see `steps.inversion`; the first is the default
PENALTIES = ("tv", "second-order", "ridge", "none")  # see `scans.constrained`
LOW_PASSES = ("none", "cosine")  # see `reconstruction.radon`
IMAGE_SUFFIXES: tuple[str, ...] = (
    ".png",
    ".npy",
    ".h5",
    ".hdf5",
    ".nii",
    ".nii.gz",
    ".tif",
    ".tiff",
)  # `io.images`
OME_ZARR = ".ome.zarr"  # a folder, see `interop.save_ome_zarr`
WITH_ERRORS = (".h5", ".hdf5")  # of images that hold how far they may be off
STREAM_SUFFIXES = (".h5", ".hdf5")  # of a file that grows, see `streams.sinks`
FORMATS = {"patato": (".hdf5", ".h5")}  # of images, and their suffixes, see `interop`
