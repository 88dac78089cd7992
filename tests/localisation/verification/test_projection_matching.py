import dataclasses

import numpy as np

from vnav.core import se3
from vnav.core.camera import CameraPrior
from vnav.localisation.photo import prepare
from vnav.localisation.verification.prediction import predict
from vnav.localisation.verification.projection_matching import (
    PATCH_OCTAVES,
    PATCH_TURN_RAD,
    match_by_projection,
    one_to_one,
)
from vnav.localisation.view import View


def view_of(world, position=(0.2, 0.1, 1.4), heading_deg=20.0):
    return View(se3.inverse(world.looking(position, heading_deg)), world.camera)


def test_matches_are_near_and_few_are_missed(world):
    view = view_of(world)
    features, which = world.seen(view.T_world_camera, world.things, np.random.default_rng(0))
    photo = prepare(features, CameraPrior(world.camera), world.database.tree)
    prediction = predict(view, world.database)
    found = match_by_projection(prediction, photo, world.database, 6.0)
    offset_px = photo.features.keypoints_px[found.feature] - prediction.px[found.predicted]
    assert np.linalg.norm(offset_px, axis=1).max() < 6.0
    matches = one_to_one(found, prediction, world.database)
    # Things are found with probability 0.7 in the photo as in the keyframes.
    assert len(matches) > 0.4 * len(np.unique(world.database.index.owner[prediction.rows]))


def test_matches_are_all_that_agree(world):
    """Each pair of prediction and feature held against the definition."""
    view = view_of(world)
    features, _ = world.seen(view.T_world_camera, world.things, np.random.default_rng(1))
    photo = prepare(features, CameraPrior(world.camera), world.database.tree)
    prediction, index, seen = predict(view, world.database), world.database.index, photo.features
    offset = seen.keypoints_px - prediction.px[:, None]
    patch = prediction.patch_px @ [1, 1j]
    octave = np.log2(2 * np.abs(patch))[:, None] - np.log2(seen.scales_px)
    turn = np.angle(patch[:, None] * np.exp(-1j * seen.angles_rad))
    described = index.descriptors[prediction.rows].astype(float)
    distance = np.linalg.norm(described[:, None] - seen.descriptors, axis=2)
    agree = np.linalg.norm(offset, axis=2) < 6.0
    agree &= (np.abs(octave) < PATCH_OCTAVES) & (np.abs(turn) < PATCH_TURN_RAD)
    agree &= distance < index.distractor_distance
    found = match_by_projection(prediction, photo, world.database, 6.0)
    assert sorted(zip(found.predicted, found.feature, strict=True)) == list(
        zip(*np.nonzero(agree), strict=True)
    )
    np.testing.assert_allclose(found.distance, distance[found.predicted, found.feature], rtol=1e-6)


def test_features_turned_on_the_spot_are_no_match_by_projection(world):
    """The same places and descriptors, but each keypoint turned by 90 degrees."""
    view = view_of(world)
    features, _ = world.seen(view.T_world_camera, world.things, np.random.default_rng(0), clutter=0)
    turned = dataclasses.replace(features, angles_rad=features.angles_rad + np.pi / 2)
    photo = prepare(turned, CameraPrior(world.camera), world.database.tree)
    assert (
        len(match_by_projection(predict(view, world.database), photo, world.database, 6.0).feature)
        == 0
    )


def test_a_photo_without_features_has_no_match_by_projection(world):
    view = view_of(world)
    features, _ = world.seen(view.T_world_camera, world.things, np.random.default_rng(0))
    photo = prepare(features[np.arange(0)], CameraPrior(world.camera), world.database.tree)
    assert (
        len(match_by_projection(predict(view, world.database), photo, world.database, 6.0).feature)
        == 0
    )
