"""Draws docs/pressure.png: contact pressure between gluteus minimus and gluteus medius at loading response, on both of them; grey: the bones.

Input:  the frame with contact (its parts `solids` and `bones`) written by
            cargo run --release -- compare walker_6mm.toml --out out/walker_6mm
        walker_6mm.toml: the built-in scene (gait-data/scenes/walker.toml) with `resolution_mm = 6.0`.
Output: the picture named by the second argument.
Run:    pip install pyvista
        python docs/pressure.py out/walker_6mm/contact/thigh_0001 docs/pressure.png
"""

import sys

import numpy as np
import pyvista as pv

# Muscle, where it is seen from (1: lateral, -1: medial), bones behind it.
VIEWS = [("gluteus_minimus", 1, "gluteus medius", ["hip_bone", "femur"]), ("gluteus_medius", -1, "gluteus minimus", [])]
# Greatest pressure that is told apart [kPa]: at the tip above the trochanter it is an order higher.
MOST = 100.0


def cells_of(grid, block):
    """Cells of a block, where they are now."""
    number = np.ravel(grid.field_data[f"block:{block}"])[0]
    return grid.extract_cells(np.flatnonzero(grid.cell_data["block"] == number))


def main(frame, picture):
    solids, skeleton = (pv.read(f"{frame}_{part}.vtu") for part in ("solids", "bones"))
    plotter = pv.Plotter(shape=(1, 2), off_screen=True, window_size=(1400, 760), border=False)
    for column, (name, side, other, bones) in enumerate(VIEWS):
        muscle = cells_of(solids, name).extract_surface(algorithm="dataset_surface")
        pressure = np.asarray(muscle.point_data["contact_pressure_Pa"]) / 1e3
        muscle["pressure [kPa]"] = pressure
        print(f"{name}: {np.nanmax(pressure):.0f} kPa at most, {np.nanpercentile(pressure, 95):.0f} kPa at 95 % of the nodes")
        plotter.subplot(0, column)
        plotter.set_background("white")
        plotter.add_mesh(
            muscle, scalars="pressure [kPa]", clim=(0.0, MOST), cmap="inferno", nan_color="#b0b0b0", above_color="#fcffa4",
            show_edges=True, edge_color="#606060", line_width=0.5, ambient=0.35, diffuse=0.7,
            scalar_bar_args=dict(color="black", title_font_size=18, label_font_size=16, fmt="%.0f", width=0.5, position_x=0.25),
        )
        for bone in bones:
            surface = cells_of(skeleton, bone).extract_surface(algorithm="dataset_surface")
            plotter.add_mesh(surface, color="#d8d2c4", ambient=0.3)
        plotter.add_text(f"{name.replace('_', ' ')}, the side of {other}", font_size=13, color="black", position="upper_edge")
        centre = np.array(muscle.center)
        plotter.camera.position = centre + np.array([0.05, 0.03, 0.4 * side])
        plotter.camera.focal_point = centre
        plotter.camera.up = (0.0, 1.0, 0.0)
        plotter.enable_parallel_projection()
        plotter.camera.parallel_scale = 0.085
    plotter.screenshot(picture)


if __name__ == "__main__":
    main(*sys.argv[1:])
