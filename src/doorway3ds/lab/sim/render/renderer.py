"""Images and depth of a scene through any pinhole camera, by MuJoCo's OpenGL renderer."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.camera.model import Camera, Pose, rotation
from doorway3ds.errors import UserError
from doorway3ds.lab.sim.homes.mesh import rotation_z
from doorway3ds.lab.sim.render.scene import FAR_M, LAMP_CUTOFF, NEAR_M, Scene


@dataclass(frozen=True)
class Eye:
    """Where a robot stands in the plan, and its camera's pose on it.

    x, y: the turning axis. heading_deg: 0 looks along +x, 90 along +y.
    """

    x: float
    y: float
    heading_deg: float
    pose: Pose

    def axes(self) -> NDArray[np.float64]:
        """(3, 3): columns are the camera's right, down and forward in the plan."""
        return rotation_z(self.heading_deg) @ rotation(self.pose)

    def lens(self) -> NDArray[np.float64]:
        """The lens in the plan (3,)."""
        offset = np.array([self.pose.forward_m, self.pose.left_m, self.pose.height_m or 0.0])
        at = np.array([self.x, self.y, 0.0]) + rotation_z(self.heading_deg) @ offset
        return np.asarray(at, np.float64)


class Renderer:
    """Draws one scene; close it before the next. One OpenGL context serves many renderers."""

    def __init__(self, scene: Scene, context: Any) -> None:
        import mujoco

        self._mj, self.scene = mujoco, scene
        screen = scene.model.vis.global_
        self.limit = (int(screen.offwidth), int(screen.offheight))
        context.make_current()
        self._data = mujoco.MjData(scene.model)
        mujoco.mj_forward(scene.model, self._data)
        self._drawn = mujoco.MjvScene(scene.model, maxgeom=scene.model.ngeom + 16)
        self._context = mujoco.MjrContext(scene.model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        option, camera = mujoco.MjvOption(), mujoco.MjvCamera()
        mujoco.mjv_updateScene(
            scene.model, self._data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, self._drawn
        )
        self._drawn.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = 0
        self._mirrors = {
            g.objid: (g, float(g.reflectance))
            for g in self._drawn.geoms[: self._drawn.ngeom]
            if g.objid in scene.mirrors
        }

    def close(self) -> None:
        self._context.free()

    def draw(
        self, camera: Camera, eye: Eye, shadows: bool = True
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """RGB (H, W, 3) and depth (H, W) in metres (nan beyond FAR_M) of the undistorted camera.

        Mirrors show what they reflect, but their depth is that of the glass.
        """
        mj, drawn = self._mj, self._drawn
        axes = eye.axes()
        self._aim(camera, eye, axes)
        self._light(eye)
        drawn.flags[mj.mjtRndFlag.mjRND_SHADOW] = int(shadows)
        self._wake_mirrors(camera, eye, axes)
        rgb = np.empty((camera.height, camera.width, 3), np.uint8)
        buffer = np.empty((camera.height, camera.width), np.float32)
        rect = mj.MjrRect(0, 0, camera.width, camera.height)
        mj.mjr_render(rect, drawn, self._context)
        mj.mjr_readPixels(rgb, buffer, rect, self._context)
        near, far = NEAR_M, FAR_M
        depth = near * far / (buffer[::-1] * (far - near) + near)
        depth[depth > far * 0.98] = np.nan
        return rgb[::-1].copy(), depth.astype(np.float32)

    def _aim(self, camera: Camera, eye: Eye, axes: NDArray[np.float64]) -> None:
        left, right = (-0.5 - camera.cx) / camera.fx, (camera.width - 0.5 - camera.cx) / camera.fx
        top, bottom = (camera.cy + 0.5) / camera.fy, (camera.cy - camera.height + 0.5) / camera.fy
        for view in self._drawn.camera:
            view.pos[:] = eye.lens()
            view.forward[:] = axes[:, 2]
            view.up[:] = -axes[:, 1]
            view.frustum_near, view.frustum_far = NEAR_M, FAR_M
            view.frustum_center = NEAR_M * (left + right) / 2
            view.frustum_width = NEAR_M * (right - left) / 2
            view.frustum_top, view.frustum_bottom = NEAR_M * top, NEAR_M * bottom
            view.orthographic = 0

    def _light(self, eye: Eye) -> None:
        """The lamp hangs in the camera's room."""
        home = self.scene.home
        room = home.room_at(eye.x, eye.y)
        if room is None:
            return
        x, y = min(room.lamps, key=lambda at: (at[0] - eye.x) ** 2 + (at[1] - eye.y) ** 2)
        for i in range(self._drawn.nlight):
            light = self._drawn.lights[i]
            if light.cutoff == LAMP_CUTOFF:
                light.pos[:] = (x, y, home.ceiling_m - 0.12)

    def _wake_mirrors(self, camera: Camera, eye: Eye, axes: NDArray[np.float64]) -> None:
        """A mirror draws the whole scene once more: only those in view may.

        One in the next room would be drawn through the wall, over what hangs on this side.
        """
        room = self.scene.home.room_at(float(eye.lens()[0]), float(eye.lens()[1]))
        for k, mirror in zip(self.scene.mirrors, self.scene.furnished.mirrors, strict=True):
            geom, reflectance = self._mirrors[k]
            yaw = np.radians(mirror.yaw_deg)
            along = np.array([np.cos(yaw), np.sin(yaw), 0.0]) * mirror.width / 2
            high = np.array([0, 0, mirror.height / 2])
            middle = np.array([mirror.x, mirror.y, mirror.z])
            corners = [middle + a * along + b * high for a in (-1, 0, 1) for b in (-1, 0, 1)]
            seen = (np.array(corners) - eye.lens()) @ axes
            limit = max(camera.width / camera.fx, camera.height / camera.fy) * 0.6
            visible = (seen[:, 2] > 0) & (np.abs(seen[:, 0]) < limit * seen[:, 2] + 0.5)
            same = room is not None and mirror.room == room.index
            geom.reflectance = reflectance if same and visible.any() else 0.0


def open_context(width: int = 1024, height: int = 768) -> Any:
    """An off-screen OpenGL context: EGL on Linux unless MUJOCO_GL names another back end.

    Raises UserError where no driver gives one.
    """
    back_end = os.environ.get("MUJOCO_GL") or ("egl" if sys.platform == "linux" else "")
    try:
        import mujoco

        # By module: mujoco.GLContext is fixed by the environment at its first import.
        if back_end in ("egl", "osmesa"):
            context = import_module(f"mujoco.{back_end}").GLContext(width, height)
        else:
            context = mujoco.GLContext(width, height)
        context.make_current()
    except Exception as error:  # PyOpenGL raises AttributeError, ImportError and its own
        if getattr(error, "name", None) == "mujoco":
            raise
        raise UserError(
            f"expected off-screen OpenGL ({back_end or 'default'}), got: {error}; on Debian "
            f"install libegl1, libopengl0 and libgl1-mesa-dri (docs/sim.md)"
        ) from error
    return context
