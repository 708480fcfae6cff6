"""Meshes for pyvista and meshio."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

#: Kinds of cells, as meshio names them.
_KINDS = {
    "Line2": "line",
    "Truss2": "line",
    "Tri3": "triangle",
    "Quad4": "quad",
    "Tet4": "tetra",
    "Tet10": "tetra10",
    "Hex8": "hexahedron",
    "Wedge6": "wedge",
}


def read(file: Path, library: str | None = None) -> Any:
    """A mesh file as pyvista or as meshio has it: as the one that is asked for, else as the one that is installed, pyvista first."""
    if library in (None, "pyvista"):
        try:
            import pyvista

            return pyvista.read(file)
        except ImportError:
            if library == "pyvista":
                raise
    try:
        import meshio
    except ImportError as missing:
        raise ImportError("meshes need pyvista or meshio: pip install sartorius[meshes]") from missing
    return meshio.read(file)


def build(points: np.ndarray, cells: list[tuple[str, str, np.ndarray]], fields: dict[str, np.ndarray]) -> Any:
    """A `meshio.Mesh` of blocks of cells, with a field per node; `part` says the block of every cell by number."""
    try:
        import meshio
    except ImportError as missing:
        raise ImportError("meshes need meshio: pip install sartorius[meshes]") from missing
    kept = [(name, _KINDS[kind], nodes) for name, kind, nodes in cells if kind in _KINDS]
    parts = [np.full(len(nodes), i) for i, (_, _, nodes) in enumerate(kept)]
    return meshio.Mesh(
        points,
        [(kind, nodes.astype(np.int64)) for _, kind, nodes in kept],
        point_data=fields,
        cell_data={"part": parts},
        info={"parts": [name for name, _, _ in kept]},
    )
