"""Finding a photo in a map: search, hypotheses, verification, verdict (claim 4)."""

import numpy as np

from vnav.localisation.hypotheses.displaced import displaced
from vnav.localisation.hypotheses.hypothesise import hypothesise
from vnav.localisation.prior import PlacePrior
from vnav.localisation.query import Query, min_matches
from vnav.localisation.search.candidates import search, search_repeated
from vnav.localisation.verdict.decision import Located, NotLocated, decide
from vnav.localisation.verification.verify import confirmed, verify


def localise(
    query: Query, rng: np.random.Generator, prior: PlacePrior | None = None
) -> Located | NotLocated:
    """Where the photo was taken, or why that cannot be said; never a guess.

    A second round looks for rivals: other places that the features of a confirmed pose match as
    well. Without one, the map may repeat itself, and all features are tried. Last come the rivals
    within a place, where the map repeats the landmarks of the confirmed pose. ``prior``: of the
    photos before; it has a say in the verdict alone, on poses that were found without it.
    """
    if len(query.photo.features) < query.config.min_features:
        return NotLocated("too few features")
    searched = search(query)
    poses = verify(hypothesise(searched.candidates, [], query, rng), query, rng)
    best = confirmed(poses, query)
    asked = best.matches.feature if best else query.all_features
    repeated = search_repeated(asked, min_matches(poses), query)
    poses += verify(hypothesise(repeated.candidates, poses, query, rng), query, rng)
    if strongest := confirmed(poses, query):
        poses += verify(displaced(strongest.view, strongest.matches, query), query, rng)
    return decide(poses, searched if best else repeated, query, prior)
