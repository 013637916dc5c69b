"""Find the packages; the library folders beside `megalopta` are installed as parts of it."""

from setuptools import find_packages, setup

FOLDERS = ("assets_gen", "flow", "render", "scenes", "sensor")
FOUND = find_packages(include=["megalopta*", *FOLDERS, *(f"{folder}.*" for folder in FOLDERS)])

setup(
    packages=[each if each.startswith("megalopta") else f"megalopta.{each}" for each in FOUND],
    package_dir={f"megalopta.{folder}": folder for folder in FOLDERS},
)
