"""A furnished home as a MuJoCo model: meshes merged by paint, textures, lights."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from doorway3ds.lab.sim.homes import furnish, shell
from doorway3ds.lab.sim.homes.apartment import Home, Room
from doorway3ds.lab.sim.homes.furnish import Furnished
from doorway3ds.lab.sim.homes.furniture import Part
from doorway3ds.lab.sim.homes.hazards import FLOORS, GLASS
from doorway3ds.lab.sim.homes.mesh import Mesh, box, join, rod, sheet
from doorway3ds.lab.sim.homes.stairs import flight_parts, pierced, ticks
from doorway3ds.lab.sim.render import surfaces, textures

Rng = np.random.Generator
NEAR_M, FAR_M = 0.03, 60.0
PALETTE = 32  # colours a side in the picture of plain paints
SKY_PX = 512
LAMP_CUTOFF = 89  # nearly a half space: a narrower cone draws its edge on the walls
ATLAS = 4  # pictures a side in the picture of pictures
_KINDS = {"painting": 6, "books": 3, "screen": 2, "rug": 4}
NAMES = [f"{kind}{i}" for kind, count in _KINDS.items() for i in range(count)]


def _own(rng: Rng) -> Rng:
    """A texture's own generator: its resolution must not change what comes after it."""
    return rng.spawn(1)[0]


@dataclass
class Builder:
    """Collects parts by (room, paint) and writes MJCF."""

    seed: int
    ppm: float
    groups: dict[tuple[int, str], list[Mesh]] = field(default_factory=lambda: defaultdict(list))
    colours: dict[str, int] = field(default_factory=dict)
    pictures: dict[str, NDArray[np.uint8]] = field(default_factory=dict)
    geoms: list[str] = field(default_factory=list)
    meshes: list[str] = field(default_factory=list)
    materials: list[str] = field(default_factory=list)
    assets: dict[str, bytes] = field(default_factory=dict)

    def add(self, room: int, paint: str, mesh: Mesh) -> None:
        if paint.startswith(("#", "!")):
            group = "glow" if paint.startswith("!") else "plain"
            index = self.colours.setdefault(paint.lstrip("!"), len(self.colours)) % PALETTE**2
            at = (np.array([index % PALETTE, index // PALETTE]) + 0.5) / PALETTE
            uv = np.broadcast_to(at, mesh.uv.shape)
        elif paint in NAMES:
            group, slot = "pictures", NAMES.index(paint)
            inset = 0.02 + 0.96 * np.clip(mesh.uv, 0, 1)
            uv = (inset + np.array([slot % ATLAS, slot // ATLAS])) / ATLAS
        elif paint.startswith("room:"):
            group, uv = paint, mesh.uv
        else:
            group = paint
            uv = mesh.uv / textures.TILE_M[paint.rstrip("0123456789")]
        self.groups[room, group].append(replace(mesh, uv=uv))

    def add_all(self, room: int, parts: Iterable[Part]) -> None:
        for paint, mesh in parts:
            self.add(room, paint, mesh)

    def texture(self, name: str, picture: NDArray[np.float32]) -> None:
        self.pictures[name] = np.ascontiguousarray((np.clip(picture, 0, 1) * 255).astype(np.uint8))

    def material(self, name: str, texture: str, attributes: str = "") -> None:
        self.materials.append(f'<material name="{name}" texture="{texture}" {attributes}/>')

    def geom(self, name: str, mesh: Mesh, material: str, rgb: tuple[float, float, float]) -> None:
        v, n, uv, f = mesh.vertices, mesh.normals, mesh.uv, mesh.faces
        head = np.array([len(v), len(n), len(uv), len(f)], "<i4").tobytes()
        body = b"".join(a.astype("<f4").tobytes() for a in (v, n, uv))
        self.assets[f"{name}.msh"] = head + body + f.astype("<i4").tobytes()
        self.meshes.append(f'<mesh name="{name}" file="{name}.msh" inertia="shell"/>')
        r, g, b = rgb
        self.geoms.append(
            f'<geom type="mesh" mesh="{name}" material="{material}" '
            f'rgba="{r:.3f} {g:.3f} {b:.3f} 1"/>'
        )


def _paints(builder: Builder, rng: Rng) -> None:
    """Woods, cloths, pictures: what furniture is covered with."""
    for i in range(3):
        builder.texture(f"wood{i}", textures.wood(_own(rng), 160))
        shine = rng.uniform(0, 0.35)
        builder.material(f"wood{i}", f"wood{i}", f'specular="{shine:.2f}" shininess="0.4"')
    for i in range(4):
        builder.texture(f"fabric{i}", textures.fabric(_own(rng), 128))
        builder.material(f"fabric{i}", f"fabric{i}", 'specular="0"')
    builder.texture("curtain", textures.curtain(_own(rng), 160))
    builder.material("curtain", "curtain", 'specular="0" emission="0.1"')
    cell = 192
    atlas = np.zeros((ATLAS * cell, ATLAS * cell, 3), np.float32)
    for slot, name in enumerate(NAMES):
        maker = getattr(textures, name.rstrip("0123456789"))
        row, column = slot // ATLAS * cell, slot % ATLAS * cell
        atlas[row : row + cell, column : column + cell] = maker(_own(rng), cell, cell)[::-1]
    builder.texture("pictures", atlas)
    builder.material("pictures", "pictures", 'specular="0.2" shininess="0.6"')


def _room(
    builder: Builder,
    furnished: Furnished,
    room: Room,
    rng: Rng,
    trim: str,
    tiles: tuple[NDArray[np.float32], NDArray[np.float32]],
) -> str:
    """Floor, walls, ceiling and skirting of a room; returns its wall colour as a plain paint."""
    home, ppm, i = furnished.home, builder.ppm, room.index
    floor_tile, wall_tile = tiles
    x0, y0, x1, y1 = room.inner(home.wall_m)
    flights = [f for f in home.flights if f.room == i]
    us = ticks(0, x1 - x0, 0.5, [v - x0 for f in flights for v in (f.x0, f.x1)])
    vs = ticks(0, y1 - y0, 0.5, [v - y0 for f in flights for v in (f.y0, f.y1)])
    scale = np.array([x1 - x0, y1 - y0])
    eye = np.eye(3)
    for name, z, up in (("floor", 0.0, 1.0), ("ceiling", home.ceiling_m, -1.0)):
        whole = sheet(np.array([x0, y0, z]), eye[0], eye[1], us, vs, eye[2] * up)
        face = pierced(whole, [f for f in flights if f.pierces == name])
        builder.add(i, f"room:{name}{i}", replace(face, uv=face.uv / scale))
    builder.texture(f"floor{i}", surfaces.floor_picture(furnished, room, floor_tile, ppm))
    shine = rng.uniform(0, 0.45) if rng.random() < 0.7 else 0.0
    if home.style.get("floor") == FLOORS.index("shiny"):
        shine = 1.0
    builder.material(f"room:floor{i}", f"floor{i}", f'specular="{shine:.2f}" shininess="0.5"')
    white = np.array([0.96, 0.955, 0.94], np.float32) * rng.uniform(0.9, 1.0)
    builder.texture(f"ceiling{i}", surfaces.ceiling_picture(furnished, room, white, ppm / 3))
    builder.material(f"room:ceiling{i}", f"ceiling{i}", 'specular="0"')
    faces, at = [], 0.0
    spans = [s for s in home.spans() if s.room == i]
    total = sum(shell.wall_face(home, room, s)[1] for s in spans)
    accent = int(rng.integers(4)) if rng.random() < 0.2 else -1
    other = textures.WALLS[rng.integers(len(textures.WALLS))](_own(rng), ppm)
    for span in spans:
        start, length, _ = shell.wall_face(home, room, span)
        tile = other if span.side == accent else wall_tile
        faces.append(surfaces.wall_picture(furnished, room, span.side, start, length, tile, ppm))
        mesh = shell.wall_mesh(home, room, span)
        inset = np.clip(mesh.uv[:, 0], 0.5 / ppm, length - 0.5 / ppm)
        uv = np.stack([(at + inset) / total, mesh.uv[:, 1] / home.ceiling_m], -1)
        builder.add(i, f"room:walls{i}", replace(mesh, uv=uv))
        at += length
        builder.add_all(i, shell.baseboards(home, room, span, trim))
    builder.texture(f"walls{i}", np.concatenate(faces, axis=1))
    builder.material(f"room:walls{i}", f"walls{i}", 'specular="0"')
    r, g, b = wall_tile.mean((0, 1)) * 0.93
    colour = f"#{int(r * 255):02x}{int(g * 255):02x}{int(b * 255):02x}"
    for flight in flights:
        builder.add_all(i, flight_parts(flight, home.ceiling_m, colour))
    return colour


def _glass(at: tuple[float, float, float], yaw: float, size: tuple[float, float], tint: str) -> str:
    (x, y, z), (w, h) = at, size
    return (
        f'<geom type="box" size="{w / 2:.4f} 0.003 {h / 2:.4f}" pos="{x:.4f} {y:.4f} {z:.4f}" '
        f'euler="0 0 {yaw:.3f}" rgba="{tint}"/>'
    )


def _openings(
    builder: Builder, furnished: Furnished, rng: Rng, trim: str, walls: list[str]
) -> None:
    """Frames, leaves, glass and balconies."""
    home = furnished.home
    wooden = rng.random() < 0.35
    leaf_paint = f"wood{rng.integers(3)}" if wooden else (trim if rng.random() < 0.8 else "#5c6770")
    frame_paint = leaf_paint if rng.random() < 0.5 else trim
    style = int(rng.integers(6))
    for portal in home.portals:
        room = max(portal.rooms)
        outer = -1 in portal.rooms
        paint = trim if outer else frame_paint
        builder.add_all(room, shell.frame_parts(home, portal, paint, walls[room]))
        leaf = shell.leaf_of(home, portal)
        if leaf is not None:
            kind = style if rng.random() < 0.8 else portal.style
            kind = GLASS if portal.style == GLASS else kind
            builder.add_all(room, shell.leaf_parts(leaf, kind, leaf_paint))
            if kind in (5, GLASS):
                tint = "0.75 0.85 0.85 0.14"
                if kind == 5:
                    tint = "0.85 0.9 0.9 0.75" if rng.random() < 0.6 else "0.8 0.9 0.9 0.2"
                builder.geoms.append(_glass(*shell.glass_of_leaf(leaf, kind), tint))
        for along, width, low, high in shell.panes(portal):
            x, y = portal.point(along)
            yaw = 90.0 if portal.axis == 0 else 0.0
            at, size = (x, y, (low + high) / 2), (width, high - low)
            builder.geoms.append(_glass(at, yaw, size, "0.75 0.85 0.85 0.12"))
        if portal.state.startswith("sliding") and outer:
            builder.add_all(-1, shell.balcony(home, portal))


def _curtains(builder: Builder, furnished: Furnished, rng: Rng) -> None:
    home = furnished.home
    for portal, room in furnished.curtains:
        side = portal.side(room)
        drop = home.ceiling_m - 0.1 if rng.random() < 0.5 else portal.height + 0.12
        foot = 0.03 if portal.sill < 0.5 or rng.random() < 0.5 else portal.sill - 0.15
        width = portal.width * rng.uniform(0.12, 0.35)
        for s in (-1, 1):
            along = s * (portal.width / 2 + 0.12 - width / 2)
            x, y = portal.point(along, side * (home.wall_m / 2 + 0.1))
            folded = box((width, 0.07, drop - foot), (0, 0, (drop + foot) / 2))
            builder.add(room, "curtain", folded.moved((x, y, 0), 90.0 if portal.axis == 0 else 0.0))
        a = portal.point(-portal.width / 2 - 0.2, side * (home.wall_m / 2 + 0.1))
        b = portal.point(portal.width / 2 + 0.2, side * (home.wall_m / 2 + 0.1))
        rail = rod((*a, drop + 0.01), (*b, drop + 0.01), 0.012, 6)
        builder.add(room, "#8d8a84", rail)


def _lights(home: Home) -> str:
    """Sun or moon, one lamp, two fills; a view moves the lamp into its own room."""
    sunny = home.style["sunny"] > 0
    azimuth, up = np.radians(home.style["sun_deg"]), np.radians(home.style["sun_up_deg"])
    d = -np.array([np.cos(azimuth) * np.cos(up), np.sin(azimuth) * np.cos(up), np.sin(up)])
    centre = np.array([*np.mean([r.centre for r in home.rooms], axis=0), 1.0])
    at = centre - d * 14
    sun = 0.5
    return (
        f'<light name="sun" type="directional" castshadow="true" pos="{at[0]:.3f} {at[1]:.3f} '
        f'{at[2]:.3f}" dir="{d[0]:.3f} {d[1]:.3f} {d[2]:.3f}" diffuse="{sun} {sun * 0.93} '
        f'{sun * 0.8}" specular="0.1 0.1 0.1" active="{"true" if sunny else "false"}"/>'
        f'<light name="lamp" type="spot" castshadow="true" pos="0 0 2.3" dir="0 0 -1" '
        f'cutoff="{LAMP_CUTOFF}" exponent="1" diffuse="0.5 0.48 0.43" specular="0.25 0.25 0.25"/>'
        '<light name="fill" type="directional" castshadow="false" dir="0.45 0.25 -0.85" '
        'diffuse="0.2 0.2 0.21" specular="0 0 0"/>'
        '<light name="back" type="directional" castshadow="false" dir="-0.6 -0.35 0.35" '
        'diffuse="0.12 0.12 0.13" specular="0 0 0"/>'
    )


@dataclass(frozen=True)
class Scene:
    """A compiled home. model: mujoco.MjModel; mirrors: geom ids beside `furnished.mirrors`."""

    furnished: Furnished
    model: Any
    mirrors: tuple[int, ...]

    @property
    def home(self) -> Home:
        return self.furnished.home


def build(
    home: Home,
    ppm: float = 72.0,
    size: tuple[int, int] = (1024, 768),
    furnished: Furnished | None = None,
) -> Scene:
    """Compile a home; `ppm` is texture pixels a metre, `size` the largest image (w, h).

    furnished: what stands in it; by default what the home's seed gives.
    """
    import mujoco

    rng = np.random.default_rng([0x5CE, home.seed])
    furnished = furnished or furnish.furnish(home)
    builder = Builder(home.seed, ppm)
    _paints(builder, rng)
    trim = "#f1efe9" if home.style["trim"] < 0.75 else f"wood{rng.integers(3)}"
    common_floor = textures.FLOORS[rng.integers(len(textures.FLOORS))](_own(rng), ppm)
    if "floor" in home.style:
        own = np.random.default_rng([0xF1, home.seed])
        common_floor = textures.hazard_floor(own, ppm, FLOORS[int(home.style["floor"])])
    common_wall = textures.plaster(_own(rng), ppm)
    walls = []
    for room in home.rooms:
        wet = room.kind in ("bath", "kitchen")
        floor = common_floor
        if wet and rng.random() < 0.7:
            floor = textures.tiles(_own(rng), ppm)
        elif rng.random() < 0.3 and "floor" not in home.style:
            floor = textures.FLOORS[rng.integers(len(textures.FLOORS))](_own(rng), ppm)
        wall = common_wall
        if room.kind == "bath" and rng.random() < 0.6:
            wall = textures.tiles(_own(rng), ppm)
        elif rng.random() < 0.55:
            wall = textures.WALLS[rng.integers(len(textures.WALLS))](_own(rng), ppm)
        walls.append(_room(builder, furnished, room, rng, trim, (floor, wall)))
    _openings(builder, furnished, rng, trim, walls)
    _curtains(builder, furnished, rng)
    for p in (*furnished.standing, *furnished.hung):
        for paint, mesh in p.item.parts:
            builder.add(p.room, paint, mesh.moved((p.x, p.y, p.z), p.yaw_deg))
    for rug in furnished.rugs:
        pile = box((rug.width, rug.depth, 0.008), (rug.x, rug.y, 0.004))
        uv = (pile.vertices[:, :2] - [rug.x, rug.y]) / [rug.width, rug.depth] + 0.5
        builder.add(rug.room, f"rug{rug.picture}", replace(pile, uv=uv))
    mirror_xml = []
    for k, m in enumerate(furnished.mirrors):
        # A box mirrors on its +z face only; the frame around it is the bigger box behind.
        c, s = np.cos(np.radians(m.yaw_deg)), np.sin(np.radians(m.yaw_deg))
        mirror_xml.append(
            f'<geom name="mirror{k}" type="box" material="mirror" size="{m.width / 2:.4f} '
            f'{m.height / 2:.4f} 0.004" pos="{m.x:.4f} {m.y:.4f} {m.z:.4f}" '
            f'xyaxes="{-c:.5f} {-s:.5f} 0 0 0 1"/>'
        )
        back = box((m.width + 0.05, 0.02, m.height + 0.05)).moved(
            (m.x + s * 0.015, m.y - c * 0.015, m.z), m.yaw_deg
        )
        builder.add(m.room, "#2c2622" if k % 2 else "wood1", back)
    palette = np.zeros((PALETTE, PALETTE, 3), np.float32)
    for colour, index in builder.colours.items():
        spot = index % PALETTE**2
        value = [int(colour[j : j + 2], 16) / 255 for j in (1, 3, 5)]
        palette[spot // PALETTE, spot % PALETTE] = value
    builder.texture("palette", np.kron(palette, np.ones((4, 4, 1), np.float32)))
    builder.material("plain", "palette", 'specular="0.15" shininess="0.4"')
    builder.material("glow", "palette", 'emission="1" specular="0"')
    outdoors = (1.0, 1.0, 1.0) if home.style["day"] else (0.15, 0.15, 0.2)
    for (index, group), parts in builder.groups.items():
        light = home.rooms[index].light if index >= 0 else outdoors
        name = f"{group.replace(':', '_')}_{index}"
        builder.geom(name, join(parts), group, light)
    sky = surfaces.skybox(_own(rng), SKY_PX, home.style["day"] > 0)
    model = mujoco.MjModel.from_xml_string(_xml(builder, home, mirror_xml, size), builder.assets)
    for name, picture in [*builder.pictures.items(), ("sky", sky)]:
        k = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXTURE, name)
        start = int(model.tex_adr[k])
        model.tex_data[start : start + picture.size] = picture.ravel()
    names = (f"mirror{k}" for k in range(len(furnished.mirrors)))
    ids = (int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)) for name in names)
    return Scene(furnished, model, tuple(ids))


def _xml(builder: Builder, home: Home, mirrors: list[str], size: tuple[int, int]) -> str:
    pictures = "".join(
        f'<texture name="{name}" type="2d" builtin="flat" width="{p.shape[1]}" '
        f'height="{p.shape[0]}"/>'
        for name, p in builder.pictures.items()
    )
    return (
        '<mujoco><compiler angle="degree"/><option gravity="0 0 0"/>'
        f'<visual><global offwidth="{size[0]}" offheight="{size[1]}"/>'
        '<quality shadowsize="1024" offsamples="4"/>'
        '<headlight ambient="0.42 0.42 0.42" diffuse="0.06 0.06 0.06" specular="0 0 0"/>'
        f'<map znear="{NEAR_M}" zfar="{FAR_M}" shadowclip="9" shadowscale="0.82"/></visual>'
        '<statistic extent="1" center="0 0 0"/>'
        '<default><geom contype="0" conaffinity="0"/></default>'
        f'<asset><texture name="sky" type="skybox" builtin="flat" width="{SKY_PX}" '
        f'height="{6 * SKY_PX}"/>{pictures}'
        '<material name="mirror" rgba="0.02 0.025 0.025 1" reflectance="0.94" specular="0"/>'
        f"{''.join(builder.materials)}{''.join(builder.meshes)}</asset><worldbody>"
        f"{_lights(home)}{''.join(builder.geoms)}{''.join(mirrors)}</worldbody></mujoco>"
    )
