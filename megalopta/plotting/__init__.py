"""Style, axes and files of figures; pages of sections."""
