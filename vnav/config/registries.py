"""What settings may name: each name, and where the class stands that it makes.

A registry is a plain dict. Whoever adds an entry has added a choice; nothing else lists them.
"""

from importlib import import_module
from typing import Any

Registry = dict[str, str]

FRONT_ENDS: Registry = {
    "sift": "vnav.features.sift:Sift",
    "orb": "vnav.features.orb:Orb",
    "brisk": "vnav.features.brisk:Brisk",
    "fast": "vnav.features.fast:Fast",
}
MASKS: Registry = {
    "none": "vnav.masking.nothing:NoMask",
    "motion": "vnav.masking.motion:MotionMask",
}
DESCRIPTORS = "descriptors"  # the tracker that has every frame described
TRACKERS: Registry = {
    DESCRIPTORS: "vnav.tracking.trackers.descriptors:DescriptorTracker",
    "klt": "vnav.tracking.trackers.klt:KltTracker",
    "ncc": "vnav.tracking.trackers.ncc:NccTracker",
    "ferns": "vnav.tracking.trackers.ferns:FernsTracker",
}
SEARCHES: Registry = {
    "compound": "vnav.localisation.search.methods:CompoundSearch",
    "interleaved": "vnav.localisation.search.methods:InterleavedSearch",
    "2d3d": "vnav.localisation.search.methods:SearchOf2d3d",
    "3d2d": "vnav.localisation.search.methods:SearchOf3d2d",
    "tree": "vnav.localisation.search.methods:TreeSearch",
}
ESTIMATORS: Registry = {
    "points3d": "vnav.registration.estimators.points3d:Points3dEstimator",
    "pnp": "vnav.registration.estimators.pnp:PnpEstimator",
    "direct": "vnav.registration.estimators.direct:DirectEstimator",
}
FILTERS: Registry = {  # of all frames, beside trackers from frame to frame
    "ekf": "vnav.tracking.filter_odometry:FilterOdometry",
}


def registered(registry: Registry, name: str) -> Any:
    """The class that a name of a registry stands for."""
    module, _, attribute = registry[name].partition(":")
    return getattr(import_module(module), attribute)
