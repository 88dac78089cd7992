import numpy as np

from vnav.localisation.matches import Matches, no_matches
from vnav.localisation.search.covisibility import covisibility_clusters, keyframe_votes


def matches_with(database, landmarks):
    landmarks = np.asarray(landmarks, np.int32)
    rows = np.arange(len(landmarks))
    return Matches(rows, rows, landmarks, np.linspace(0.1, 0.5, len(landmarks)))


def test_landmarks_of_two_rooms_are_two_places(twin_world):
    index = twin_world.database.index
    keyframe_landmarks = [index.landmarks_of(np.array([k])) for k in (0, 12)]  # one of each room
    found = matches_with(
        twin_world.database,
        np.concatenate([keyframe_landmarks[0][:30], keyframe_landmarks[1][:20]]),
    )
    first, second = covisibility_clusters(found, index, 5, 5)[:2]
    assert len(first.matches) == 30
    assert len(second.matches) == 20
    for place in (first, second):
        rooms = index.points_world[place.matches.landmark, 0] > 10
        assert rooms.all() or not rooms.any()


def test_a_place_with_too_few_matches_is_none(twin_world):
    index = twin_world.database.index
    found = matches_with(twin_world.database, index.landmarks_of(np.array([0]))[:4])
    assert covisibility_clusters(found, index, 5, 5) == []
    assert keyframe_votes(found, index).max() == 4


def test_no_matches_have_no_places(twin_world):
    assert covisibility_clusters(no_matches(), twin_world.database.index, 5, 1) == []
    assert not keyframe_votes(no_matches(), twin_world.database.index).any()
