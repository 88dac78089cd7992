"""What is said of a photo: for programs and for people."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import PhotoCamera
from vnav.localisation.photo import Photo
from vnav.localisation.prior import PlacePrior
from vnav.localisation.verdict.decision import Located, NotLocated
from vnav.localisation.verdict.uncertainty import Sigmas
from vnav.localisation.verification.verify import VerifiedPose
from vnav.localisation.view import View

IMAGE = Path("image")
HELD = "held by the photos before"  # what is said of a pose that is not given without them
UNLIKELY = 0.02  # places of an ambiguous photo that are not worth telling


@dataclass(frozen=True)
class PhotoAnswer:
    """A photo and where it was taken, or the reason why that is not known.

    ``photo`` is what was searched: features and intrinsics of the scaled and undistorted image;
    ``camera`` belongs to the file; ``path`` is its name, or ``IMAGE`` for pixels
    that have none. ``prior``: that of a photo that follows others, whether it was needed or not.
    """

    path: Path
    photo: Photo
    camera: PhotoCamera
    result: Located | NotLocated
    reason: str
    warnings: tuple[str, ...]
    seconds: dict[str, float]
    prior: PlacePrior | None = None

    @property
    def located(self) -> bool:
        """Whether a pose is given."""
        return isinstance(self.result, Located)

    @property
    def T_world_camera(self) -> Array | None:
        """Where the photo was taken (4, 4), None where that is not known."""
        return self.best.view.T_world_camera if self.best else None

    @property
    def best(self) -> VerifiedPose | None:
        """The pose that is given, if one is."""
        return self.result.best if isinstance(self.result, Located) else None

    @property
    def held_by_prior(self) -> bool:
        """Whether a pose is given that is not without the photos before."""
        return isinstance(self.result, Located) and self.result.prior is not None

    @property
    def sigmas(self) -> Sigmas | None:
        """How far off the pose may be, if one is given."""
        return self.result.sigmas if isinstance(self.result, Located) else None

    @property
    def confidence(self) -> float | None:
        """Probability that the pose is within 25 cm and 10 degrees, if one is given."""
        return self.result.confidence if isinstance(self.result, Located) else None

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON; null for what is not known."""
        best, sigmas = self.best, self.sigmas
        return {
            "photo": str(self.path),
            "located": best is not None,
            "reason": self.reason or None,
            **_pose(best.view if best else None),
            "intrinsics": self._intrinsics(best.view) if best else None,
            "intrinsics_source": self.camera.source,
            "features": len(self.photo.features),
            "matches": self.result.matches,
            "inliers": self.result.inliers,
            "sigma_position_m": sigmas.position_m.tolist() if sigmas else None,
            "sigma_rotation_deg": np.rad2deg(sigmas.rotation_rad).tolist() if sigmas else None,
            "confidence": self.confidence,
            "hypotheses": [
                _pose(h.view) | {"inliers": h.inliers, "probability": round(chance, 4)}
                for h, chance in zip(self.result.hypotheses, self.result.chances, strict=True)
            ],
            **self._prior(),
            "seconds": self.seconds,
        }

    def _prior(self) -> dict[str, Any]:
        """What the photos before told, and whether the pose is not given without it."""
        if self.prior is None:
            return {}
        return {"prior": self.prior.as_dict() | {"needed": self.held_by_prior}}

    def _intrinsics(self, view: View) -> dict[str, Any]:
        """The camera of the file, its focal length and principal point as they came out."""
        k = self.camera.intrinsics
        found = view.intrinsics.scaled(*k.size)
        values: dict[str, Any] = {"width": k.width, "height": k.height}
        values |= {"fx": found.fx, "fy": found.fy, "cx": found.cx, "cy": found.cy}
        values |= {"distortion": list(k.distortion)}
        sigma = self.sigmas.focal if self.sigmas else 0.0
        return values | {"sigma_fx": found.fx * sigma}


@dataclass(frozen=True)
class UnreadablePhoto:
    """A photo that could not be read, and why."""

    path: Path
    reason: str

    @property
    def located(self) -> bool:
        """Never."""
        return False

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {"photo": str(self.path), "located": False, "reason": self.reason}


def summary(answer: PhotoAnswer | UnreadablePhoto) -> str:
    """A line for a person."""
    if isinstance(answer, UnreadablePhoto):
        return f"{answer.path}: unreadable: {answer.reason}"
    best, sigmas = answer.best, answer.sigmas
    if best is None or sigmas is None:
        return f"{answer.path}: not located: {answer.reason}{_rivals(answer.result)}"
    x, y, z = best.view.centre_world
    forward = best.view.T_world_camera[:3, 2]
    heading_deg = np.rad2deg(np.arctan2(forward[1], forward[0]))
    return (
        f"{answer.path}: at {x:.3f} {y:.3f} {z:.3f} m, heading {heading_deg:.0f} deg,"
        f" {sigmas}; {best.inliers} inliers, camera {answer.camera.source}"
        f"{f'; {HELD}' if answer.held_by_prior else ''}"
    )


def _rivals(result: Located | NotLocated) -> str:
    """Where a photo may have been taken that was taken in one of several places."""
    pairs = zip(result.hypotheses, result.chances, strict=True)
    likely = [(h.view.centre_world, chance) for h, chance in pairs if chance > UNLIKELY]
    if len(likely) < 2:
        return ""
    places = [f"{x:.2f} {y:.2f} {z:.2f} m ({chance:.0%})" for (x, y, z), chance in likely]
    sure = sum(chance for _, chance in likely)
    return f"; {' or '.join(places)} may be it, and with {1 - sure:.0%} none of these"


def _pose(view: View | None) -> dict[str, Any]:
    if view is None:
        return dict.fromkeys(("T_world_camera", "position_m", "quaternion_xyzw"))
    T = view.T_world_camera
    return {
        "T_world_camera": T.tolist(),
        "position_m": T[:3, 3].tolist(),
        "quaternion_xyzw": se3.quat_xyzw(T).tolist(),
    }
