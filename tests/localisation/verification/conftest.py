import numpy as np
import pytest

from vnav.core.camera import CameraPrior
from vnav.localisation.photo import prepare
from vnav.localisation.verification.prediction import Prediction


@pytest.fixture
def scene(world):
    """A photo whose features lie where the map predicts landmarks, one each, all over it."""
    rng = np.random.default_rng(0)
    features, _ = world.seen(world.looking((0, 0, 1.4), 0), world.things, rng, clutter=0)
    photo = prepare(features, CameraPrior(world.camera), world.database.tree)
    px = photo.features.keypoints_px.astype(float)
    return photo, Prediction(np.arange(len(px)), px, np.ones((len(px), 2)))
