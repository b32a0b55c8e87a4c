"""Pixel-Selection and Pixel2Angle of Othman & Rad 2020, under the name that their users look for."""

from doorway3ds.decide.paper import PixelSelection, pixel_to_angle, select_pixels

__all__ = ["PixelSelection", "pixel_to_angle", "select_pixels"]
