"""Panels as meshes with a painted surface, for Drake's renderer: Wavefront files and PNG textures.

A panel's texture is what its silver Teflon tape looks like: strips of slightly different shades,
faint seams, soft mottling, a dark edge strip. Defects are not in the texture, whose pixels are too
coarse for them, but pieces of mesh a little above the surface, so their edges are as sharp as the
camera is. Everything is grey and dull: the real tape is a mirror, which no lamp of this renderer
could show.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.cable_robot.defects import Defect, defect_patches
from pips_drake.cable_robot.panels import Panel, panel_normals, panel_points
from pips_drake.config import require

Array = NDArray[np.float64]

#: How far defects stand above the surface, m.
PATCH_HEIGHT = 0.2e-3
#: Chords of the arc stand out of it by no more than this, m.
CHORD_HEIGHT = 0.02e-3
#: The panels' brightness, of 1.
BRIGHTNESS = 0.6
_RAMP = "paint_ramp.png"


@dataclass(frozen=True, kw_only=True)
class PanelLook:
    """How panels without defects look.

    Attributes:
        pixel: of the texture, m.
        strip: width of a strip of tape along u, m (4 in, assumed).
        strips: largest difference of a strip's brightness from the mean, as a share of it.
        seam: how much darker seams are, as a share.
        mottling: standard deviation of the mottling, as a share.
        patches: size of the mottling's patches, m.
        edge: width of the dark strip along the panel's edges, m.
        seed: of shades and mottling.
    """

    pixel: float = 0.002
    strip: float = 0.1016
    strips: float = 0.02
    seam: float = 0.03
    mottling: float = 0.02
    patches: float = 0.12
    edge: float = 0.004
    seed: int = 0

    def __post_init__(self) -> None:
        good = 0.0005 <= self.pixel <= 0.02
        require(good, "pixel of the panels' texture", f"{self.pixel:g} m", "0.0005 .. 0.02 m")


def panel_texture(panel: Panel, look: PanelLook | None = None) -> NDArray[np.uint8]:
    """Grey texture (pixels along v, pixels along u); row 0 is the edge v = width."""
    look = look or PanelLook()
    rng = np.random.default_rng([look.seed, panel.number, 1 + panel.side])
    shape = [max(round(size / look.pixel), 2) for size in (panel.length, panel.width)]
    u, v = (
        (np.arange(n) + 0.5) * size / n
        for n, size in zip(shape, (panel.length, panel.width), strict=True)
    )
    strip = np.floor(u / look.strip).astype(int)
    shade = rng.uniform(-look.strips, look.strips, strip[-1] + 1)[strip]
    # One pixel of seam where a strip ends.
    shade[1:] -= look.seam * (strip[1:] != strip[:-1])
    spots = [math.ceil(size / look.patches) + 4 for size in (panel.length, panel.width)]
    coarse = rng.normal(0.0, look.mottling, spots)
    soft = _smooth(u / look.patches, spots[0]) @ coarse @ _smooth(v / look.patches, spots[1]).T
    grey = BRIGHTNESS * (1.0 + shade[:, None] + soft)
    outside = np.minimum(u, panel.length - u)[:, None] < look.edge
    outside = outside | (np.minimum(v, panel.width - v)[None] < look.edge)
    grey[outside] *= 0.6
    return np.rint(255.0 * np.clip(grey.T[::-1], 0.0, 1.0)).astype(np.uint8)


def write_panel(
    folder: Path, panel: Panel, defects: Sequence[Defect] = (), look: PanelLook | None = None
) -> Path:
    """Writes a panel and its defects as `<panel's name>.obj` with its material and textures.

    Vertices are in {W}, so the geometry's pose in the world is the identity.

    Args:
        defects: of all panels; those of others are left out.

    Returns:
        The Wavefront file.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _save_png(folder / f"{panel.name}.png", panel_texture(panel, look))
    _save_png(folder / _RAMP, np.arange(256, dtype=np.uint8)[None].repeat(4, axis=0))
    _save_text(
        folder / f"{panel.name}.mtl",
        "".join(
            f"newmtl {name}\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nmap_Kd {file}\n"
            for name, file in (("tape", f"{panel.name}.png"), ("paint", _RAMP))
        ),
    )
    surface = _surface(panel)
    # With the renderer's linear filter the ramp's middle line has every grey there is.
    greys, points, triangles, count = [], [], [], len(surface[0])
    for defect in defects:
        if defect.panel != panel.name:
            continue
        for patch in defect_patches(defect):
            greys += [BRIGHTNESS * (1.0 + patch.contrast)] * len(patch.points)
            points.append(patch.points)
            triangles.append(patch.triangles + count)
            count += len(patch.points)
    painted = np.concatenate(points) if points else np.empty((0, 2))
    uv = np.concatenate([surface[0], painted])
    height = np.repeat([0.0, PATCH_HEIGHT], [len(surface[0]), len(painted)])
    level = (255.0 * np.clip(np.array(greys), 0.0, 1.0) + 0.5) / 256.0
    texture = np.concatenate(
        [
            surface[0] / [panel.length, panel.width],
            np.column_stack([level, np.full(len(level), 0.5)]),
        ]
    )
    lines = [f"mtllib {panel.name}.mtl\n"]
    lines += _rows("v", panel_points(panel, uv, height), 7)
    lines += _rows("vt", texture, 6)
    lines += _rows("vn", panel_normals(panel, uv), 6)
    # u x v is the normal on the starboard side and its opposite on the port side.
    for name, faces in (("tape", [surface[1]]), ("paint", triangles)):
        if faces:
            turned = np.concatenate(faces)[:, :: panel.side] + 1
            lines.append(f"usemtl {name}\n")
            lines += [f"f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}\n" for a, b, c in turned.tolist()]
    file = folder / f"{panel.name}.obj"
    _save_text(file, "".join(lines))
    return file


def write_panels(
    folder: Path,
    panels: Sequence[Panel],
    defects: Sequence[Defect] = (),
    look: PanelLook | None = None,
) -> dict[str, Path]:
    """`write_panel` for each panel: files by panels' names."""
    return {panel.name: write_panel(folder, panel, defects, look) for panel in panels}


def _surface(panel: Panel) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (u, v) and triangles of the arc, as strips along u."""
    turn = 2.0 * math.acos(1.0 - CHORD_HEIGHT / panel.radius)
    n = math.ceil(panel.width / panel.radius / turn)
    v = np.linspace(0.0, panel.width, n + 1)
    uv = np.stack(np.meshgrid(v, [0.0, panel.length], indexing="ij"), axis=-1)[..., ::-1]
    k = 2 * np.arange(n)
    faces = [np.column_stack([k, k + 1, k + 3]), np.column_stack([k, k + 3, k + 2])]
    return uv.reshape(-1, 2), np.concatenate(faces)


def _smooth(places: Array, count: int) -> Array:
    """Weights (N, count) of cubic B-splines at whole numbers -1 .. count - 2."""
    x = np.abs(places[:, None] - (np.arange(count) - 1.0))
    near = 2.0 / 3.0 - x**2 + 0.5 * x**3
    far = np.maximum(2.0 - x, 0.0) ** 3 / 6.0
    return np.where(x < 1.0, near, far)


def _rows(key: str, values: ArrayLike, digits: int) -> list[str]:
    form = key + f" %.{digits}f" * np.shape(values)[1] + "\n"
    return [form % tuple(row) for row in np.asarray(values).tolist()]


def _save_text(file: Path, text: str) -> None:
    part = file.with_name(file.name + ".part")
    part.write_text(text, encoding="ascii")
    part.replace(file)


def _save_png(file: Path, grey: NDArray[np.uint8]) -> None:
    from PIL import Image

    part = file.with_name(file.name + ".part")
    Image.fromarray(grey).convert("RGB").save(part, format="png", compress_level=1)
    part.replace(file)
