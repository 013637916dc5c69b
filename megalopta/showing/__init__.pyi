from .card import write_card as write_card
from .sheet import write_view as write_view
