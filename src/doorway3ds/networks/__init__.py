"""What runs a network: one ONNX Runtime session class, one adapter per network, a registry.

An adapter is a `Network`: it takes an image and its camera and returns a `Perception` that
holds what the network gives and None (p_open: nan) for what it does not.
"""

from doorway3ds.networks.base import Joined, Network
from doorway3ds.networks.registry import load

__all__ = ["Joined", "Network", "load"]
