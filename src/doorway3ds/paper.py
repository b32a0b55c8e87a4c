"""Pixel-Selection and Pixel2Angle of Othman & Rad 2020, where their users look for them."""

from doorway3ds.decide.paper import PixelSelection, pixel_to_angle, select_pixels

__all__ = ["PixelSelection", "pixel_to_angle", "select_pixels"]
