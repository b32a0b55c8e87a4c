"""Cameras of known robots, and where they sit on them.

Fields of view of the presets, each of a 640x480 image:

- NAO V4/V5 (MT9M114): 60.9 x 47.6 deg, top camera 0.05871 m in front of and 0.06364 m above
  the neck joint, tilted 0.0209 rad down.
  http://doc.aldebaran.com/2-0/family/robots/video_robot.html
- Pepper (OV5640): 56.3 x 43.7 deg, top camera 0.0868 m in front of and 0.1631 m above the neck
  joint, not tilted. (NAOqi 2.0's page printed 57.2 x 44.3 deg; 2.4 and 2.8 print these.)
  http://doc.aldebaran.com/2-8/family/pepper_technical/video_2D_pep.html,
  http://doc.aldebaran.com/2-4/family/pepper_technical/video_pep.html
- NAO V6: the same OV5640 camera module as Pepper, mounted as in V5.
  http://doc.aldebaran.com/2-8/family/nao_technical/video_naov6.html
"""

from __future__ import annotations

from doorway3ds.camera.model import Camera, Pose
from doorway3ds.errors import UserError

# Heights with legs straight. NAO: foot 0.045, tibia 0.103, thigh 0.100, hip 0.085, neck 0.1265,
# camera 0.0636 m. Pepper, by its URDF: base 0.334, pelvis 0.268, hip 0.079, torso 0.139, neck
# 0.170, camera 0.163 m; the neck stands 0.038 m behind the turning axis.
_NAO_POSE = Pose(height_m=0.52, pitch_deg=-1.2, forward_m=0.059)

PRESETS: dict[str, tuple[Camera, Pose]] = {
    "nao-v5-top": (Camera.from_fov(640, 480, 60.9, 47.6, "nao-v5-top"), _NAO_POSE),
    "nao-v6-top": (Camera.from_fov(640, 480, 56.3, 43.7, "nao-v6-top"), _NAO_POSE),
    "pepper-top": (
        Camera.from_fov(640, 480, 56.3, 43.7, "pepper-top"),
        Pose(height_m=1.15, forward_m=0.049),
    ),
}


def preset(name: str, width: int, height: int) -> tuple[Camera, Pose]:
    """The preset's camera for an image of this size, and its pose with the head at zero."""
    if name not in PRESETS:
        raise UserError(f"no camera preset '{name}'; expected one of {', '.join(sorted(PRESETS))}")
    camera, pose = PRESETS[name]
    return camera.scaled_to(width, height), pose
