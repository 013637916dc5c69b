"""A package that is installed by a folder of metadata alone."""

import os


def environment_with(package, entry_points, site):
    """Environment of processes in which a package (its folder) has some entry points."""
    name = package.name.replace("_", "-")
    info = site / f"{package.name}-0.1.dist-info"
    info.mkdir(parents=True, exist_ok=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 0.1\n")
    (info / "entry_points.txt").write_text(entry_points)
    return os.environ | {"PYTHONPATH": os.pathsep.join((str(site), str(package)))}
