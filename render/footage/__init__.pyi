from .frames import Footage as Footage, Unit as Unit
from .opening import SUFFIXES as SUFFIXES, is_footage as is_footage, open_footage as open_footage
