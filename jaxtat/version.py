"""The version, for the package's metadata and the files that jaxtat writes."""

__version__ = "0.3.0"
