"""Pictures of the user's own as light: what `sense INPUT` writes, and what the other verbs do then."""

import json
import shutil

import numpy as np
import pytest
from PIL import Image

import megalopta
from megalopta.cli.main import main
from megalopta.config.model import load
from megalopta.core.errors import UserError
from megalopta.dataset.opened import open_dataset
from megalopta.sensor import read_frames
from megalopta.stages import importing

from ..small import made, small


def moving_texture(frames=6, rows=48, columns=64, step=1):
    """Smooth noise that moves to the right, 8-bit codes (T, H, W, 3)."""
    rng = np.random.default_rng(5)
    wide = rng.uniform(20, 220, (rows // 2, columns, 3))
    wide = wide.repeat(4, axis=0).repeat(4, axis=1)[:rows, : 2 * columns]
    shown = [wide[:, columns - step * k : 2 * columns - step * k] for k in range(frames)]
    return np.stack(shown).astype(np.uint8)


@pytest.fixture
def here(tmp_path, monkeypatch):
    """The folder that the program runs in, with an array, a folder of pictures and a gray board."""
    monkeypatch.chdir(tmp_path)
    texture = moving_texture()
    np.save("clip.npy", texture)
    (tmp_path / "folder").mkdir()
    for index, each in enumerate(texture):
        Image.fromarray(each).save(tmp_path / "folder" / f"shot {index}.png")
    np.save("gray.npy", np.full((2, 8, 8), 0.5, np.float32))
    return tmp_path


def photons_of(dataset):
    return np.asarray(open_dataset(dataset)[0].counts(quantity="photons"), np.float64)


@pytest.mark.parametrize("source", ["clip.npy", "folder"])
@pytest.mark.parametrize("sensor", ["ideal", "spadcam"])
def test_photons_are_as_many_as_asked_for_and_drawn_about_their_mean(here, source, sensor):
    unit = ["--unit", "srgb"] if source.endswith("npy") else []
    main(["sense", source, *unit, "--photons", "2", "--sensors", sensor, "--out", "out"])
    (sequence,) = open_dataset("out")
    assert photons_of("out").mean() == pytest.approx(2, rel=1e-3)
    counts = np.asarray(sequence.counts(), np.float64)
    expected, variance = (
        np.asarray(sequence.counts(quantity=name), np.float64)
        for name in ("mean_reading", "reading_variance")
    )
    # 6 σ: a false alarm in 1e8 runs
    assert abs((counts - expected).sum()) < 6 * np.sqrt(variance.sum())
    linear = np.where(
        (c := moving_texture() / 255) < 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4
    )
    light = np.asarray(sequence.radiance, np.float64)
    assert light.shape == (6, 48, 64, 4)
    # The bands together are a smooth sum of the colors: white and black pixels keep their ratio.
    # The bluest, 400 to 500 nm, has some green.
    red, blue = light[..., 3], light[..., 0]
    assert np.corrcoef(red.ravel(), linear[..., 0].ravel())[0, 1] > 0.999
    assert np.corrcoef(blue.ravel(), linear[..., 2].ravel())[0, 1] > 0.97


def test_lux_becomes_the_photons_of_a_rendered_board_of_the_same_luminance(here):
    board = small(8, 8, 2, samples=16, sensors="ideal", levels=0.01)
    board |= {"scene.kind": "plane", "scene.contrast": "0", "scene.period_m": "9"}
    made(here / "board", load("grating", board))
    # The board glows with a flat spectrum, as a white surface does under the light.
    how = ["--unit", "linear", "--lux", "0.01", "--reflectance", "1", "--spectrum", "equal_energy"]
    main(["sense", "gray.npy", *how, "--out", "gray", "--frame-rate", "10"])
    assert photons_of("gray").mean() == pytest.approx(photons_of("board").mean(), rel=0.01)


def test_luminance_and_absolute_arrays_are_one_light(here):
    np.save("absolute.npy", np.full((2, 8, 8), 0.02, np.float32))
    main(["sense", "gray.npy", "--unit", "linear", "--luminance", "0.02", "--out", "a"])
    main(["sense", "absolute.npy", "--unit", "cd/m2", "--out", "b"])
    main(["sense", "gray.npy", "--unit", "linear", "--lux", f"{np.pi * 0.02 / 0.18}", "--out", "c"])
    first, *others = map(photons_of, "abc")
    for other in others:
        np.testing.assert_allclose(other, first, rtol=1e-5)


def test_one_call_from_python_counts_the_same_light(here):
    texture = moving_texture()
    exposure = megalopta.photons_from_images(texture, 2, "ideal")
    main(["sense", "clip.npy", "--unit", "srgb", "--photons", "2", "--out", "out"])
    stored = photons_of("out")
    np.testing.assert_allclose(exposure.expectation.photons, stored, rtol=1e-3)  # of the level
    assert exposure.counts.shape == texture.shape[:3]
    again = megalopta.photons_from_images("folder", 2, "ideal")
    np.testing.assert_array_equal(again.counts, exposure.counts)
    floats = megalopta.photons_from_images(texture / 255, 2, "ideal", unit="srgb")
    np.testing.assert_allclose(floats.expectation.photons, exposure.expectation.photons, rtol=1e-5)
    with pytest.raises(UserError, match="give unit='srgb'"):
        megalopta.photons_from_images(texture / 255, 2)
    with pytest.raises(UserError, match="photons_per_pixel or lux"):
        megalopta.photons_from_images(texture)
    with pytest.raises(UserError, match="ages: reflectance: input should be less than or equal"):
        megalopta.photons_from_images(texture, 2, reflectance=2)
    with pytest.raises(UserError, match="outside the efficiency curve"):
        megalopta.photons_from_images(texture, 2, "ctia_si")


def test_the_dataset_goes_on_without_the_file_and_says_what_it_lacks(here, refused):
    main(["sense", "folder", "--photons", "50", "--out", "out"])
    shutil.rmtree(here / "folder")
    main(["sense", "out", "--light-levels", "1e-4", "--redo"])
    main(["flow", "out", "--methods", "BM", "DIS", "LK"])  # LK leaves blocks without a velocity
    main(["report", "out"])
    main(["check", "files", "out"])
    page = (here / "out/report.html").read_text("utf-8")
    assert "flow of the clean pictures" in page and "favors DIS" in page
    assert "true motion" not in page.partition("Glossary</h2>")[0].replace(
        "true motion of pictures", ""
    ).replace("unknown true motion", "")
    records = json.loads((here / "out/results/folder/flow.json").read_text())
    best = next(each for each in records if each["method"] == "DIS")
    assert best["truth"]["ideal"]["relative_error_median"] < 0.25
    for words in (["check", "truth", "out"], ["benchmark", "sequence", "out", "--out", "rk"]):
        assert "made of pictures, whose true motion and depth are unknown" in refused(*words)
    with pytest.raises(UserError, match="made of pictures"):
        open_dataset("out").pairs()
    with pytest.raises(UserError, match="made of pictures"):
        open_dataset("out")[0].flow(0)


def test_readings_alone_are_a_tenth_and_what_needs_more_is_refused(here, refused):
    words = ["sense", "folder", "--photons", "2", "--expectation", "false", "--out", "out"]
    main(words)
    main(words)  # finished: nothing is done again
    (store,) = (here / "out/counts/folder").iterdir()
    assert {each.name for each in store.iterdir() if each.is_dir()} == {"counts", "saturated"}
    for verb in ("flow", "report"):
        assert "--expectation true --redo" in refused(verb, "out")


def test_frames_between_pictures_are_held_blended_or_moved(here):
    step = 4
    np.save("steps.npy", moving_texture(frames=3, rows=48, columns=64, step=step))
    light = {}
    for between in ("hold", "blend", "flow"):
        how = ["--picture-rate", "10", "--frame-rate", "20", "--between", between]
        main(["sense", "steps.npy", "--unit", "srgb", "--photons", "9", *how, "--out", between])
        light[between] = np.asarray(open_dataset(between)[0].radiance)
        assert len(light[between]) == 5
    np.testing.assert_array_equal(light["hold"][1], light["hold"][0])
    np.testing.assert_allclose(
        light["blend"][1], (light["blend"][0] + light["blend"][2]) / 2, rtol=1e-5
    )
    # Moved, the middle frame is the first one shifted by half a step.
    inside = np.s_[8:-8, 12:-12]
    shifted = np.roll(light["flow"][0], step // 2, axis=1)[inside]
    errors = [np.abs(light[name][1][inside] - shifted).mean() for name in ("flow", "blend")]
    assert errors[0] < 0.4 * errors[1]


def test_a_burst_holds_its_picture_or_goes_on_to_the_next(here):
    np.save("flash.npy", np.stack([np.full((8, 8), level, np.uint8) for level in (10, 250, 10)]))
    how = ["--unit", "srgb", "--photons", "40", "--frame-rate", "10", "--products", "counts"]
    how += ["burst_npy", "--burst-hz", "1000"]
    rates = {}
    for between, parts in (("hold", "1"), ("blend", "10")):
        out = ["--between", between, "--sub-frames", parts, "--out", between]
        main(["sense", "flash.npy", *how, *out])
        (path,) = (here / between / "counts/flash").glob("*.burst.npy")
        bits = read_frames(path, shape=(8, 8)).counts
        rates[between] = bits.mean(axis=(1, 2)).reshape(3, 100)
    first_dark, first_bright = rates["hold"][0], rates["hold"][1]
    # 64 pixels of 100 frames: the standard error of a mean of bits is below 0.007, and 6 of them
    # are 0.04; a picture that is held gives the same rate from the first bit to the last.
    assert abs(first_bright[:50].mean() - first_bright[50:].mean()) < 0.06
    assert first_bright.mean() > 10 * first_dark.mean()
    rising = rates["blend"][0]
    assert rising[80:].mean() > 3 * rising[:20].mean()


def test_size_rate_and_number_of_frames_are_changed_and_told(here, capsys):
    how = ["--unit", "srgb", "--photons", "2", "--width", "32", "--frames", "4"]
    main(["sense", "clip.npy", *how, "--frame-rate", "50", "--out", "out"])
    told = capsys.readouterr().err
    assert "4 frames of 32 × 24 px at 50 Hz" in told
    (sequence,) = open_dataset("out")
    assert sequence.shape == (24, 32) and len(sequence) == 4
    np.testing.assert_allclose(np.diff(sequence.times_s), 0.02)
    assert photons_of("out").mean() == pytest.approx(2, rel=0.01)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["clip.npy", "--unit", "srgb"], "pictures do not say how bright it was; give one of --photons"),
        (["clip.npy", "--unit", "srgb", "--photons", "2", "--lux", "1"], "--photons and --lux"),
        (["clip.npy", "--photons", "2"], "give the unit srgb"),
        (["clip.npy", "--unit", "srgb", "--photons", "0"], "numbers above 0"),
        (["gone.mp4", "--photons", "2"], "no such file"),
        (["black.npy", "--unit", "srgb", "--photons", "2"], "black.npy is black"),
        (["clip.npy", "--unit", "srgb", "--lux", "1e-13"], "light level 1e-13 lux"),
        (["clip.npy", "--unit", "srgb", "--photons", "2", "--workers", "2"], "omit --workers"),
        (["clip.npy", "--unit", "srgb", "--photons", "2", "--spectrum", "pink"], "spectrum"),
        (["whole", "--photons", "2"], "--photons: for pictures"),
        (["clip.npy", "--unit", "srgb", "--lux", "1", "--light-levels", "2"], "--lux and --light-levels"),
        (["clip.npy", "--unit", "srgb", "--photons", "1", "--products", "counts", "burst_npy", "--burst-hz", "90"], "burst_hz 90"),
        (["folder", "--photons", "2", "--sensors", "{preset: ideal, exposure_s: 0.01, tcspc: {bins: 9, from_camera: true}}"], "no depth"),
    ],
)  # fmt: skip
def test_wrong_inputs_are_one_sentence(here, whole, words, told, refused):
    np.save("black.npy", np.zeros((2, 8, 8), np.uint8))
    shutil.copytree(whole, here / "whole")
    assert told in refused("sense", *words) and not (here / "out").exists()


def test_pictures_are_refused_where_things_are_rendered(here, refused):
    (here / "plan.yaml").write_text(
        "scenes: [{preset: demo, scene: {kind: pictures, file: folder}}]\n"
    )
    assert "a plan renders" in refused("dataset", "make", "plan.yaml")
    (here / "own.yaml").write_text(
        "scene: {kind: pictures, file: folder}\ncamera: {width: 32, height: 30}\n"
        "objects: [{kind: box}]\n"
    )
    assert "objects" in refused("render", "own.yaml")
    text = (here / "own.yaml").read_text().replace("objects: [{kind: box}]\n", "")
    (here / "own.yaml").write_text(text)
    assert "has 64 × 48 px; give a size of the same shape" in refused("render", "own.yaml")


def test_changed_pictures_are_refused(here, refused):
    main(["sense", "folder", "--photons", "2", "--out", "out"])
    Image.fromarray(moving_texture()[3]).save(here / "folder" / "shot 0.png")
    assert "add --redo" in refused("sense", "folder", "--photons", "2", "--out", "out")
    (here / "out/pictures/folder/source/000001.png").write_bytes(b"not a picture")
    assert "is missing or damaged" in refused("benchmark", "photons", "out")


def write_gif(path, lasts_ms):
    frames = [Image.fromarray(each) for each in moving_texture()]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=lasts_ms)


def test_frames_show_the_picture_of_their_time(here):
    write_gif(here / "uneven.gif", [20, 50, 80, 20, 30, 40])
    main(["sense", "uneven.gif", "--photons", "9", "--frame-rate", "100", "--out", "out"])
    assert photons_of("out").mean() == pytest.approx(9, rel=1e-3)
    light = np.asarray(open_dataset("out")[0].radiance)
    changes = np.abs(np.diff(light, axis=0)).max(axis=(1, 2, 3)) > 0
    assert (np.flatnonzero(changes) + 1).tolist() == [2, 7, 15, 17, 20]


@pytest.mark.parametrize(
    ("rate_hz", "told"),
    [(24.999999999999996, 25), (29.999999999999, 30), (30000 / 1001, 29.97002997), (0.1 + 0.2, 0.3),
     (12.5, 12.5), (23.976, 23.976), (1 / 3, 0.333333333), (1e-3, 1e-3), (119999.99999999999, 120000)],
)  # fmt: skip
def test_a_frame_rate_is_the_shortest_number_that_the_times_allow(rate_hz, told):
    assert importing.shortest(rate_hz) == told
