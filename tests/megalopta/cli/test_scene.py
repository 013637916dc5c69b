import trimesh

from megalopta.cli import main as cli

SMALL = (
    "--scene.kind grating --trajectory.velocity-m-s [0,0,0] --trajectory.look-at-m [9,0,1.5] "
    "--trajectory.frames 2 --camera.width 32 --camera.height 24"
).split()


def test_a_frame_is_exported_and_its_file_named(tmp_path, capsys, refused):
    path = tmp_path / "out" / "scene.glb"
    words = ["scene", "export", "demo", "--out", str(path), *SMALL]
    assert "frames are 0 to 1" in refused(*words, "--frame", "2")
    assert not path.parent.exists()
    cli.main([*words, "--frame", "1"])
    assert capsys.readouterr().out.strip() == str(path)
    assert [*trimesh.load_scene(path).graph.nodes_geometry] == ["grating 1"]
