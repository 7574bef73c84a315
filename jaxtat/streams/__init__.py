"""From raw frames to images as fast as they come: all that does not depend on them found before."""

from .images import Live, live

__all__ = ["Live", "live"]
