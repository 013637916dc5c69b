"""Exact ground truth from rays through the pixel centers."""
