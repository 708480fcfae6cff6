"""Draws docs/gallery.png: squashed block, twisted cylinder, contracted fibre bar, the first two coloured by von Mises stress;
grey: the rest shape.

Input:  the .vtu files written by
            cargo run --release -p sartorius-fem --example gallery -- out/gallery
Output: the picture named by the second argument.
Run:    pip install pyvista
        python docs/gallery.py out/gallery docs/gallery.png
"""

import sys
from pathlib import Path

import numpy as np
import pyvista as pv

FRAMES = 10


def frame(folder, name, number):
    part = Path(folder, name, f"{name}_{number:04}_solids.vtu")
    solids = pv.read(part)
    solids.cell_data["stress [kPa]"] = solids.cell_data["von_mises_Pa"] / 1e3
    fibres = part.with_name(f"{name}_{number:04}_fibres.vtu")
    return solids, pv.read(fibres) if fibres.exists() else None


def whole(octant):
    """The block from its octant, mirrored in x, y and z."""
    parts = [octant]
    for normal in np.eye(3):
        parts += [part.reflect(normal, point=(0, 0, 0)) for part in parts]
    return parts


def draw(plotter, grids, limits, title, edges=0.25):
    """Adds the surfaces coloured by stress; returns the last of them."""
    for grid in grids:
        surface = grid.extract_surface(algorithm="dataset_surface")
        actor = plotter.add_mesh(
            surface, scalars="stress [kPa]", clim=limits, cmap="viridis", show_edges=True, edge_color="#202020",
            line_width=0.6, edge_opacity=edges, show_scalar_bar=False, smooth_shading=False, ambient=0.25, diffuse=0.8,
        )
    plotter.add_text(title, font_size=13, color="black", position="upper_edge")
    return actor


def generators(cylinder, n=8):
    """Lines that were straight along the side of the cylinder."""
    rest = cylinder.points - cylinder.point_data["displacement_m"]
    on_side = np.hypot(rest[:, 0], rest[:, 1]) > 0.00999
    angle = np.arctan2(rest[:, 1], rest[:, 0])
    for k in range(n):
        turned = np.angle(np.exp(1j * (angle - 2 * np.pi * k / n)))
        line = np.flatnonzero(on_side & (np.abs(turned) < 1e-6))
        line = line[np.argsort(rest[line, 2])]
        yield pv.Spline(cylinder.points[line], 400).tube(radius=0.00025)


def main(folder, picture):
    plotter = pv.Plotter(shape=(1, 3), off_screen=True, window_size=(1500, 640), border=False)
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    limits = (0, 30)

    plotter.subplot(0, 0)
    block, _ = frame(folder, "squash", FRAMES)
    draw(plotter, whole(block), limits, "Bonded block, squashed to half")
    outline = pv.Box((-0.01, 0.01, -0.01, 0.01, -0.01, 0.01)).extract_all_edges()
    plotter.add_mesh(outline, color="#808080", line_width=2)
    plotter.camera_position = [(0.046, -0.082, 0.038), (0, 0, -0.001), (0, 0, 1)]

    plotter.subplot(0, 1)
    cylinder, _ = frame(folder, "twist", FRAMES)
    actor = draw(plotter, [cylinder], limits, "Cylinder, twisted by 270°", edges=0.12)
    for line in generators(cylinder):
        plotter.add_mesh(line, color="#f5f5f5")
    plotter.camera_position = [(0.065, -0.075, 0.065), (0, 0, 0.0185), (0, 0, 1)]
    plotter.add_scalar_bar(
        "von Mises stress [kPa]", width=0.7, height=0.07, position_x=0.15, position_y=0.04,
        title_font_size=18, label_font_size=16, n_labels=4, fmt="%.0f", color="black", mapper=actor.mapper,
    )

    plotter.subplot(0, 2)
    muscle, fibres = frame(folder, "contraction", FRAMES)
    half = muscle.extract_cells(muscle.cell_centers().points[:, 1] > 0.016)
    plotter.add_mesh(half.extract_surface(algorithm="dataset_surface"), color="#e3c9b4", show_edges=True,
                     edge_color="#8a6d55", line_width=1, ambient=0.2)
    plotter.add_text("Fibres shorten a bar (cut open)", font_size=13, color="black", position="upper_edge")
    plotter.add_mesh(fibres.extract_surface(algorithm="dataset_surface").tube(radius=0.0009), color="#c0392b")
    outline = pv.Box((0, 0.1, 0, 0.03, 0, 0.03)).extract_all_edges()
    plotter.add_mesh(outline, color="#808080", line_width=2)
    plotter.camera_position = [(0.12, -0.215, 0.12), (0.05, 0.015, 0.012), (0, 0, 1)]

    plotter.screenshot(picture)


if __name__ == "__main__":
    main(*sys.argv[1:])
