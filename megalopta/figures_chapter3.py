"""Figures and table of Chapter 3: the CTIA pixel."""

from megalopta.figure import Registry

CHAPTER_3: Registry = {}
