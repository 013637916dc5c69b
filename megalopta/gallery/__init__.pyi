from .sheet import write_gallery as write_gallery
