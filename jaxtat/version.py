"""The version, for the package's metadata and for whatever jaxtat writes."""

__version__ = "0.2.0"
