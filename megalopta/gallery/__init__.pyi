from .sheet import write_gallery as write_gallery
from .statistics import write_statistics as write_statistics
from .views import write_views as write_views
