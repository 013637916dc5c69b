"""Light is baked once for a scene, whoever renders it."""

import pytest

from megalopta.config.model import load
from megalopta.render import choose_variant
from megalopta.stages.run import run_stage

from ..small import small

SETTINGS = small(24, 24, 3, samples=9) | {
    "scene.trees": "8",
    "scene.density_per_ha": "80",
    "scene.undergrowth": "0",
    "render.max_depth": "3",
    "render.integrator": "baked",
    "render.bake_error": "0.1",
}


@pytest.mark.slow
def test_light_is_baked_once_for_all_who_render_the_same(tmp_path, monkeypatch):
    if choose_variant().name.startswith("scalar"):
        pytest.skip("baking needs a vectorized variant")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    bakes, frames = set(), set()
    for name in ("first", "second"):
        dataset = run_stage(tmp_path / name, load("demo", {**SETTINGS, "name": name}), "render")
        (kept,) = (tmp_path / "cache/megalopta/light").glob("*.npz")
        bakes.add(kept.stat().st_ino)  # a new bake would put another file in its place
        frames.add(tuple(dataset.radiance(index).read_bytes() for index in range(3)))
    assert len(bakes) == len(frames) == 1
