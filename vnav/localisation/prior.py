"""What the photos before tell of where the next one of a sequence was taken."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vnav.core.arrays import Array
from vnav.core.map_index import MapIndex
from vnav.localisation.view import View

MOST_ODDS = 5.0  # wrong poses are not spread evenly: some lie beside the right one


@dataclass(frozen=True)
class PlacePrior:
    """The camera's centre (3,) at the last photo that was located, and how sure that was.

    ``step_m``: how far it moves, as a rule, from photo to photo, of which there were ``steps``
    since. How often it moves farther the sequence tells: of ``told`` photos that were located by
    themselves, so many ``jumped``.
    """

    photo: str
    centre_world: Array
    confidence: float
    step_m: float
    steps: int = 1
    told: int = 0
    jumped: int = 0

    def after_another(self) -> "PlacePrior":
        """One photo later, which was not located."""
        return replace(self, steps=self.steps + 1)

    def after(self, photo: str, view: View, confidence: float, alone: bool) -> "PlacePrior":
        """One photo later, which was located, ``alone`` or held by this."""
        far = not self._within_reach(view.centre_world[None])[0]
        return replace(
            self,
            photo=photo,
            centre_world=view.centre_world,
            confidence=confidence,
            steps=1,
            told=self.told + alone,
            jumped=self.jumped + (alone and bool(far)),
        )

    @property
    def reach_m(self) -> float:
        """How far the camera may be, as a rule."""
        return self.steps * self.step_m

    def odds(self, views: Sequence[View], index: MapIndex) -> Array:
        """Of each view (V,): how much likelier a right pose is there than a chance one, a priori.

        Chance poses lie anywhere in the map, which its keyframes tell; so do right ones where the
        prior errs, else within reach.
        """
        share = float(self._within_reach(index.T_world_keyframe[:, :3, 3]).mean())
        errs = self._errs(share)
        near = min(MOST_ODDS, (1 - errs) / share + errs) if share else 1.0
        centres = np.array([view.centre_world for view in views]).reshape(-1, 3)
        return np.where(self._within_reach(centres), near, errs)

    def _errs(self, share: float) -> float:
        """Probability that the camera is anywhere in the map, of which a share is within reach.

        A camera that is anywhere is out of reach as often as the rest of the map is. The rule of
        succession says how often it is: photos have to show that they are a sequence.
        """
        out_of_reach = (self.jumped + 1) / (self.told + 2)
        anywhere = out_of_reach / max(1 - share, out_of_reach)
        return min(1.0, anywhere + 1 - self.confidence)

    def _within_reach(self, points_world: Array) -> Array:
        return np.asarray(np.linalg.norm(points_world - self.centre_world, axis=1) <= self.reach_m)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "photo": self.photo,
            "position_m": self.centre_world.tolist(),
            "confidence": self.confidence,
            "reach_m": self.reach_m,
            "told": self.told,
            "jumped": self.jumped,
        }
