"""Images from anywhere by one URI: files, videos, webcams, streams, robots, simulated homes."""

from doorway3ds.sources.base import Capture, Shot, Source, SourceLost, View
from doorway3ds.sources.uri import open_source

__all__ = ["Capture", "Shot", "Source", "SourceLost", "View", "open_source"]
