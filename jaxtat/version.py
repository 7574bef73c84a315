"""The version, for the package's metadata and for whatever jaxtat writes."""

__version__ = "0.1.0"
