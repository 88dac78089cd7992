import dataclasses

import numpy as np
import pytest

from vnav.config import LocateConfig
from vnav.core.camera import CameraPrior
from vnav.localisation.photo import prepare
from vnav.localisation.query import Query, missing_levels


def query_of(world, **settings) -> Query:
    T = world.looking((0.4, -0.3, 1.5), 40.0)
    features, _ = world.seen(T, world.things, np.random.default_rng(5))
    photo = prepare(features, CameraPrior(world.camera), world.database.tree)
    return Query(photo, world.database, dataclasses.replace(LocateConfig(), **settings))


def test_levels_counted_from_the_leaves_are_told_from_the_root(world):
    deepest = world.database.tree.levels
    query = query_of(world, levels_from="leaves", level_2d_3d=0, level_3d_2d=deepest)
    assert (query.level_2d_3d, query.level_3d_2d) == (deepest, 0)


def test_by_default_features_are_searched_in_the_finest_words(world):
    assert query_of(world).level_2d_3d == world.database.tree.levels


@pytest.mark.parametrize(("counted_from", "taken"), [("root", -1), ("leaves", 0)])
def test_a_level_that_the_tree_does_not_have_is_said(world, counted_from, taken):
    """The level that is searched is the deepest counted from the root, the root from the leaves."""
    tree = world.database.tree
    config = LocateConfig(levels_from=counted_from, level_2d_3d=20, level_3d_2d=1)
    (said,) = missing_levels(config, tree)
    assert said == (
        "expected locate.level_2d_3d to be a level of the map's vocabulary tree, 0 to"
        f" {tree.levels} from the {counted_from}, found 20: level {tree.levels} is searched"
    )
    query = query_of(world, levels_from=counted_from, level_2d_3d=20)
    assert query.level_2d_3d == (tree.levels if taken else 0)


def test_of_levels_that_the_tree_has_nothing_is_said(world):
    assert missing_levels(LocateConfig(), world.database.tree) == ()
