"""Pixels of a loaded scene: films, passes and custom cameras."""
