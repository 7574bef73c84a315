"""From raw frames to images as they arrive; what does not depend on them is precomputed."""

from .images import Live, live
from .run import Streamed, stream
from .sinks import Folder, GrowingFile, Sink
from .sources import frames_of_bytes, frames_of_folder

__all__ = [
    "Folder",
    "GrowingFile",
    "Live",
    "Sink",
    "Streamed",
    "frames_of_bytes",
    "frames_of_folder",
    "live",
    "stream",
]
