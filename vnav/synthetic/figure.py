"""A person made of boxes that turn about joints: posture in, textured rectangles out.

Own frame of every joint at rest: x forward, y to the left, z up; lengths in metres of a person of
1.75 m. A joint bends about its y axis alone, so that a posture is one angle for each.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.synthetic.clothes import CLOTHES
from vnav.synthetic.raycast import Rectangles
from vnav.synthetic.scene import LIGHT, SMALL_TEXEL_M, Box, Face, faces_of, rectangles_of
from vnav.synthetic.textures import texture

HEIGHT_M = 1.75
THIGH_M, SHIN_M, ANKLE_M = 0.43, 0.41, 0.07
STRIDE_M = 1.35  # walked in two steps
JOINTS: dict[str, tuple[str, tuple[float, float, float]]] = {  # parent, place in its frame
    "torso": ("hips", (0, 0, 0.12)),
    "head": ("torso", (0, 0, 0.53)),
    **{f"arm {s}": ("torso", (0, y, 0.45)) for s, y in (("left", 0.235), ("right", -0.235))},
    **{f"forearm {s}": (f"arm {s}", (0, 0, -0.29)) for s in ("left", "right")},
    **{f"thigh {s}": ("hips", (0, y, 0)) for s, y in (("left", 0.095), ("right", -0.095))},
    **{f"shin {s}": (f"thigh {s}", (0, 0, -THIGH_M)) for s in ("left", "right")},
    **{f"foot {s}": (f"shin {s}", (0, 0, -SHIN_M)) for s in ("left", "right")},
}
Part = tuple[str, tuple[float, float, float], tuple[float, float, float], str]  # joint and a box
CORE: tuple[Part, ...] = (
    ("hips", (0, 0, 0.05), (0.21, 0.35, 0.19), "trousers"),
    ("torso", (0, 0, 0.23), (0.23, 0.38, 0.50), "shirt"),
    ("head", (0, 0, -0.02), (0.10, 0.11, 0.08), "skin"),
    ("head", (0.01, 0, 0.11), (0.19, 0.16, 0.22), "head"),
    ("head", (-0.015, 0, 0.175), (0.20, 0.175, 0.13), "hair"),
)
LIMBS: tuple[Part, ...] = (
    ("arm", (0, 0, -0.13), (0.115, 0.095, 0.33), "shirt"),
    ("forearm", (0, 0, -0.11), (0.09, 0.08, 0.27), "sleeve"),
    ("forearm", (0, 0, -0.31), (0.09, 0.045, 0.15), "skin"),
    ("thigh", (0, 0, -0.20), (0.165, 0.16, 0.47), "trousers"),
    ("shin", (0, 0, -0.19), (0.125, 0.12, 0.43), "trousers"),
    ("foot", (0.06, 0, -0.025), (0.27, 0.105, 0.09), "shoe"),
)


@dataclass(frozen=True)
class Posture:
    """Where a person is and what the body does there.

    ``x_m``, ``y_m`` between the feet; ``yaw_rad`` 0 along +x; ``walked_m`` so far, which says where
    in the stride the legs are; ``swing`` 0 (stands) to 1 (full steps); ``sit`` 0 to 1 (sits, the
    feet where they were).
    """

    x_m: float
    y_m: float
    yaw_rad: float
    walked_m: float
    swing: float
    sit: float


@dataclass(frozen=True)
class Figure:
    """Somebody's size and clothes; materials by garment."""

    height_m: float
    materials: dict[str, str]
    seed: tuple[int, ...]

    @cached_property
    def parts(self) -> tuple[tuple[str, str, tuple[Face, ...]], ...]:
        """Each box's joint, its garment and its faces in the joint's frame."""
        sides = ("left", "right")
        all_parts = CORE + tuple((f"{p[0]} {side}", *p[1:]) for side in sides for p in LIMBS)
        scale = self.height_m / HEIGHT_M
        found = []
        for number, (joint, centre, size, garment) in enumerate(all_parts):
            x, y, z = (scale * np.array(centre)).tolist()
            length, width, height = (scale * np.array(size)).tolist()
            front = "face" if garment == "head" else ""
            material = self.materials["skin" if garment == "head" else garment]
            box = Box((x, y, z), (length, width, height), 0.0, material, front)
            found.append((joint, garment, tuple(faces_of(box, number))))
        return tuple(found)

    def rectangles(self, posture: Posture) -> Rectangles:
        """All faces in the world."""
        T_world = self._joints(posture)
        parts = [rectangles_of(faces).moved(T_world[joint]) for joint, _, faces in self.parts]
        return Rectangles.joined(parts)

    def images(self) -> list[NDArray[np.uint8]]:
        """A texture for each of the faces, in their order; a garment has its colours everywhere."""
        faces = [(garment, face) for _, garment, faces in self.parts for face in faces]
        return [self._image(garment, face, number) for number, (garment, face) in enumerate(faces)]

    def _image(self, garment: str, face: Face, number: int) -> NDArray[np.uint8]:
        tone = "skin" if face.material in ("skin", "face") else garment.replace("sleeve", "shirt")
        colors = np.random.default_rng([*self.seed, 0, *tone.encode()])
        rng = np.random.default_rng([*self.seed, 1, number])
        image = texture(CLOTHES[face.material], face.size_m, SMALL_TEXEL_M, colors, rng)
        light = 0.80 + 0.20 * float(face.normal @ LIGHT)
        return np.asarray(np.clip(image * light, 0, 255), np.uint8)

    def _joints(self, posture: Posture) -> dict[str, NDArray[np.float64]]:
        """T_world_joint of every joint; the lower foot stands on the floor."""
        scale = self.height_m / HEIGHT_M
        bend = bends(posture)
        legs = [
            (bend[f"thigh {s}"], bend[f"thigh {s}"] + bend[f"shin {s}"]) for s in ("left", "right")
        ]
        height = max(THIGH_M * np.cos(a) + SHIN_M * np.cos(b) for a, b in legs) + ANKLE_M
        back = np.sin(np.pi / 2 * posture.sit) * THIGH_M
        at = scale * np.array(
            [-back * np.cos(posture.yaw_rad), -back * np.sin(posture.yaw_rad), height]
        )
        place = at + [posture.x_m, posture.y_m, 0]
        T = {"hips": se3.make(se3.exp_so3([0, 0, posture.yaw_rad]), place)}
        for joint, (parent, offset) in JOINTS.items():
            R = se3.exp_so3([0, -bend[joint], 0])
            T[joint] = T[parent] @ se3.make(R, scale * np.array(offset))
        return T


def bends(posture: Posture) -> dict[str, float]:
    """How far each joint is turned forward against its parent, in radians."""
    stride = 2 * np.pi * posture.walked_m / STRIDE_M
    seated = np.pi / 2 * posture.sit
    lean = -0.7 * np.sin(np.pi * posture.sit) - 0.04 * posture.swing
    found = {"torso": lean, "head": -0.5 * lean}
    for side, phase in (("left", stride), ("right", stride + np.pi)):
        thigh = 0.42 * posture.swing * np.sin(phase) + seated
        shin = -posture.swing * (0.08 + 0.85 * max(0.0, np.cos(phase))) - seated
        found |= {f"thigh {side}": thigh, f"shin {side}": shin, f"foot {side}": -thigh - shin}
        found[f"arm {side}"] = -0.4 * posture.swing * np.sin(phase) + 0.35 * posture.sit - lean
        found[f"forearm {side}"] = 0.2 + 0.25 * posture.swing + 0.9 * posture.sit
    return {joint: float(angle) for joint, angle in found.items()}


def dressed(rng: np.random.Generator, seed: tuple[int, ...]) -> Figure:
    """Somebody with clothes of their own; ``seed`` of the patterns."""
    shirt = str(rng.choice(["striped", "checked", "printed"]))
    materials = {
        "shirt": shirt,
        "sleeve": str(rng.choice([shirt, "skin"])),
        "trousers": str(rng.choice(["denim", "denim", "printed"])),
        **{name: name for name in ("skin", "hair", "shoe")},
    }
    return Figure(float(rng.uniform(1.60, 1.88)), materials, seed)
