"""One camera in, one safe turn out: doorway direction for social robots."""

__version__ = "0.1.0"
