import pytest
import trimesh

from megalopta.cli import main as cli

SMALL = (
    "--scene.kind grating --trajectory.velocity-m-s [0,0,0] --trajectory.look-at-m [9,0,1.5] "
    "--trajectory.frames 2 --camera.width 32 --camera.height 24"
).split()


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--frame", "2"], "frames are 0 to 1"),
        (["--scene.contrast", "2"], "scene.contrast"),
        (["--out", "out/scene.xml"], "is no .glb file"),
    ],
)
def test_what_cannot_be_exported_is_told(tmp_path, refused, words, reason):
    told = refused("scene", "export", "demo", "--out", tmp_path / "out/s.glb", *SMALL, *words)
    assert reason in told
    assert not (tmp_path / "out").exists()


def test_a_name_of_a_glb_file_exports_one(tmp_path, capsys):
    path = tmp_path / "out" / "scene.glb"
    cli.main(["scene", "export", "demo", "--out", str(path), *SMALL])
    assert capsys.readouterr().out.strip() == str(path)
    assert [*trimesh.load_scene(path).graph.nodes_geometry] == ["grating 1"]
