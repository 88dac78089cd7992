import dataclasses

import cv2
import numpy as np

from vnav.core.camera import CameraPrior
from vnav.localisation.photo import prepare


def features_of(world, seed=0):
    rng = np.random.default_rng(seed)
    return world.seen(world.looking((0, 0, 1.4), 0), world.things, rng)[0]


def test_each_node_knows_its_features(world):
    photo = prepare(features_of(world), CameraPrior(world.camera), world.database.tree)
    for row, path in enumerate(photo.paths):
        for node in path:
            first, last = photo.span[node]
            assert first <= row < last


def test_distortion_is_taken_out(world):
    features = features_of(world)
    bent = dataclasses.replace(world.camera, distortion=(0.1, -0.05, 0.001, 0.002, 0.0))
    points = world.camera.unproject(features.keypoints_px, np.ones(len(features)))
    px, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), bent.K, np.array(bent.distortion))
    distorted = dataclasses.replace(features, keypoints_px=px[:, 0])
    photo = prepare(distorted, CameraPrior(bent), world.database.tree)
    straight = prepare(features, CameraPrior(world.camera), world.database.tree)
    assert photo.intrinsics.distortion == ()
    # OpenCV undistorts by iteration; a tenth of a pixel is far below a keypoint's noise.
    np.testing.assert_allclose(
        photo.features.keypoints_px, straight.features.keypoints_px, atol=0.1
    )


def test_no_features_are_legal(world):
    photo = prepare(
        features_of(world)[np.arange(0)], CameraPrior(world.camera), world.database.tree
    )
    assert len(photo.buckets(5.0).order) == 0
