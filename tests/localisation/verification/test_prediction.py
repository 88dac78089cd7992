import numpy as np

from vnav.core import se3
from vnav.localisation.verification.prediction import local_keyframes, predict
from vnav.localisation.view import View


def view_of(world, position=(0.2, 0.1, 1.4), heading_deg=20.0):
    return View(se3.inverse(world.looking(position, heading_deg)), world.camera)


def test_what_is_predicted_lies_in_the_image_before_the_camera(world):
    view = view_of(world)
    prediction = predict(view, world.database)
    index = world.database.index
    px, depth = view.project(index.points_world[index.owner[prediction.rows]])
    assert len(prediction) > 50
    assert (depth > 0).all()
    np.testing.assert_allclose(px, prediction.px)
    assert ((px >= 0) & (px < world.camera.size)).all()


def test_nothing_is_predicted_behind_what_no_keyframe_saw(world):
    """From 20 m behind the wall all landmarks project into the image, from another viewpoint."""
    assert len(predict(view_of(world, (-20.0, 0.0, 1.2), 0.0), world.database)) == 0


def test_local_keyframes_look_the_same_way(world):
    view = view_of(world)
    index = world.database.index
    axes = index.T_world_keyframe[local_keyframes(view, index), :3, 2]
    # 53 degrees of view: keyframes turned by more share nothing with the photo.
    assert len(axes) >= 2
    assert (axes @ view.T_world_camera[:3, 2] > np.cos(np.deg2rad(60))).all()
