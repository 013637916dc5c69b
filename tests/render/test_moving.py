"""What moves, in frames of many poses: shared poses, two scenes, and truth met in float64."""

import numpy as np
import pytest

from megalopta.assets_gen.bodies import box
from megalopta.render import RenderSettings, SceneRenderer
from megalopta.render.loading.meshes import MovingMesh, merge
from megalopta.render.loading.scene import MovingScene
from megalopta.render.surface_view import SHARED_PX, lines_of_a_pose
from megalopta.scenes import MovingObject, PerspectiveCamera, Scene, Shutter, Trajectory
from megalopta.scenes.material import Material
from megalopta.scenes.motion import Drift
from megalopta.scenes.moving_objects import with_objects
from megalopta.scenes.scene import Asset, Lighting, Placement, Sun
from megalopta.scenes.spectra.spectrum import flat

CAMERA = PerspectiveCamera(width=40, height=30, fov_deg=70)
SETTINGS = RenderSettings(samples_per_pixel=16, integrator="path", max_depth=6)
WATCH = Trajectory(frames=3, position_m=(0, 0, 1.5), look_at_m=(1, 0, 1.4))
FOCAL = 20 / np.tan(np.radians(35))


def scene(*motions):
    """Ground in sun and sky, posts on it, and a box for each motion."""
    light = Lighting(flat(1e-9), Sun((0.5, -0.5, 0.7), flat(5e-9)))
    ground = Asset({"ground": box((40, 40, 0.1), 1.0).to_mesh()})
    placements = (Placement("ground", "ground", np.eye(4)),)
    bare = Scene({"ground": Material(flat(0.3))}, {"ground": ground}, placements, light)
    posts = [MovingObject(position_m=(4, y, 0.6), size_m=(0.2, 0.2, 1.2)) for y in (-2, -1, 0, 1)]
    boxes = [
        MovingObject(position_m=(3, side, 1.5), motion=motion)
        for side, motion in zip((1, -1), motions, strict=False)
    ]
    return with_objects(bare, [*posts, *boxes])


SPINNING = Drift(velocity_m_s=(0, -2, 0), spin_deg_s=90), Drift(velocity_m_s=(0, 1, 0.5))


@pytest.fixture(scope="module")
def renderer():
    return SceneRenderer(scene(*SPINNING), CAMERA, SETTINGS)


def test_a_blurred_frame_is_the_mean_of_its_poses(renderer):
    assert isinstance(renderer._view._exposing._layers, MovingScene)
    shutter = Shutter(exposure_s=0.1, poses=4)
    blurred = renderer.exposed(WATCH, shutter, 1, seed=5)
    view = renderer._view
    exposure = renderer._exposure(WATCH, shutter, 1, 5, 0)
    film, images = view._film(4, True), []
    for part in exposure.parts:
        view.move_to(part.line_times_s[0])
        images.append(film.expose(view._integrator.render, view._loaded, part.poses, part.seed))
    np.testing.assert_allclose(blurred, np.mean(images, axis=0), atol=1e-4 * blurred.mean())


def rows_shared(speed, readout_s=0.03):
    """Rows of a pose before a box that goes across the view, 2.75 m away at its nearest face."""
    meshes = [
        m for m in merge(scene(Drift(velocity_m_s=(0, speed, 0)))) if isinstance(m, MovingMesh)
    ]
    times = readout_s * (np.arange(CAMERA.height) / (CAMERA.height - 1) - 0.5)
    return lines_of_a_pose(meshes, CAMERA, WATCH.poses()[0], times.tolist())


@pytest.mark.parametrize("speed", [0.001, 0.3, 1.0, 3.0, 30.0])
def test_rows_share_a_pose_where_nothing_moves_by_more_than_they_may(speed):
    rows = rows_shared(speed)
    # The image of the face goes as fast, within a tenth: it is before the camera.
    of_a_row = FOCAL * speed / 2.75 * 0.03 / (CAMERA.height - 1)
    assert (rows - 1) * of_a_row <= SHARED_PX
    # Never more poses than a few times what that asks for.
    assert rows == CAMERA.height or rows * of_a_row > SHARED_PX / 4


@pytest.mark.slow
def test_rays_of_many_times_meet_what_those_of_one_time_meet(renderer):
    geometry = renderer._tracer._geometry
    rng = np.random.default_rng(4)
    times = rng.choice(np.linspace(-0.1, 0.4, 6), 3000)
    directions = rng.normal(size=(3000, 3))  # all around: bundles are divided
    directions[:1500] = rng.normal([3, 0, 0], 0.7, (1500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = np.stack([0.1 * times, -times, 1.5 + times], axis=1)
    found = geometry.seen(origins, directions, times)
    limits = rng.uniform(1, 6, 3000)
    hidden = geometry.is_hidden(origins, directions, limits, times)
    moving = 0
    for time in np.unique(times):
        some = times == time
        alone = geometry.seen(origins[some][0], directions[some], float(time))
        # A ray may pass within float32's rounding of an edge.
        same = found.triangle[some] == alone.triangle
        assert same.mean() > 0.998
        np.testing.assert_allclose(found.points[some][same], alone.points[same], atol=1e-6)
        alone = geometry.is_hidden(origins[some][0], directions[some], limits[some], float(time))
        assert (hidden[some] == alone).mean() > 0.998
        moving += (geometry.object_id[found.triangle[some]] > 5).sum()
    assert moving > 100
