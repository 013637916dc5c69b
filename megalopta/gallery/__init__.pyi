from .sheet import write_gallery as write_gallery
from .views import write_views as write_views
