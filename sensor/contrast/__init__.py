"""Event cameras that report changes of contrast: the pixel, and its events."""
