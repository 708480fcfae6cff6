"""Either side of the coupling by itself."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Callable, Mapping, Optional, Sequence

import numpy as np

from . import _core, _meshes
from ._tables import table


class Session:
    """A deformable thigh that is driven from Python: set poses and activations, solve, read forces and fields, save and restore.

    Lengths are in m, forces in N, moments in N m, in the axes of the mesh with the femur at rest: x forward, y up, z to the right. The pose
    of a bone is the map from where the mesh has it to where it is: translation x, y, z [m] and quaternion w, x, y, z.

    Results hang on the state and the inputs alone, to the last bit: a state that was saved and restored goes on as if nothing had been in
    between.

    Parameters
    ----------
    scene
        Scene file (TOML), or the name of a shipped scene.
    contact
        Whether surfaces see each other; by default as the scene says.
    data
        Folder of the recordings and surfaces that the scene names.
    cache
        Folder of kept calibrations; `out/calibration-cache` by default, as for `compare`.
    progress
        Called as each stage of making it ends, with its name and its seconds.

    Examples
    --------
    >>> import sartorius
    >>> thigh = sartorius.Session("three_muscles", contact=False)   # doctest: +SKIP
    >>> leg = thigh.rigid_leg()                                     # doctest: +SKIP
    >>> leg.go_to(0.0)                                              # doctest: +SKIP
    >>> thigh.follow(leg)                                           # doctest: +SKIP
    >>> thigh.solve()                                               # doctest: +SKIP
    >>> thigh.forces()                                              # doctest: +SKIP
    """

    def __init__(
        self,
        scene: str | os.PathLike[str] = "walker",
        *,
        contact: Optional[bool] = None,
        data: str | os.PathLike[str] | None = None,
        cache: str | os.PathLike[str] | None = None,
        progress: Optional[Callable[[str, float], None]] = None,
    ) -> None:
        # Calibrations lie beside what is named here, whatever its own name.
        beside = Path("out") if cache is None else Path(cache).parent
        self._data = data
        self._core = _core.Thigh(scene, data, contact, beside / "session", progress)

    @property
    def muscles(self) -> list[str]:
        """Names of the muscles, in the order of activations and forces."""
        return self._core.muscles

    @property
    def bones(self) -> list[str]:
        """Names of the bones, in the order of poses and wrenches."""
        return list(self._core.bones)

    @property
    def coordinates(self) -> list[str]:
        """Names of the joint coordinates of lever arms and moments."""
        return list(self._core.coordinates)

    @property
    def n_nodes(self) -> int:
        """Nodes of the mesh, those of bones in contact included."""
        return self._core.n_nodes

    @property
    def activation_range(self) -> tuple[float, float]:
        """Least and greatest activation that can be given."""
        return self._core.activation_range

    @property
    def time(self) -> float:
        """Time of the state [s]; an equilibrium does not hang on it."""
        return self._core.time

    @time.setter
    def time(self, seconds: float) -> None:
        self._core.set_time(float(seconds))

    def set_poses(self, poses: Any) -> None:
        """Poses of all bones from the next solution on: array [bones, 7], translation x, y, z [m] and unit quaternion w, x, y, z."""
        self._core.set_poses(np.asarray(poses, dtype=float).tolist())

    def set_activations(self, activations: Any) -> None:
        """Activations of all muscles from the next solution on: array [muscles], or a mapping from muscle to activation (others: 0)."""
        if isinstance(activations, Mapping):
            unknown = [name for name in activations if name not in self.muscles]
            if unknown:
                raise _core.InputError(f"activations: there is no muscle {', '.join(unknown)}; there are {', '.join(self.muscles)}")
            activations = [activations.get(name, 0.0) for name in self.muscles]
        self._core.set_activations(np.asarray(activations, dtype=float).tolist())

    def set_twists(self, twists: Any) -> None:
        """How the bones move with the joint coordinates: array [bones, coordinates, 6], velocity at the hip centre of the mesh and angular
        velocity. Lever arms and moments are nothing until this is known."""
        self._core.set_twists(np.asarray(twists, dtype=float).tolist())

    def solve(self) -> None:
        """Goes to the equilibrium under the poses and activations that were set.

        Raises `NotConverged` where there is none, and `KeyboardInterrupt` on Ctrl-C; the session then stays where it is.
        """
        self._core.solve()

    def forces(self) -> Any:
        """Table with a row per muscle: force through the belly and its parts [N], fibre stretch, lever arms [m] and moments [N m]."""
        return table(self._core.forces())

    @property
    def section_forces(self) -> np.ndarray:
        """Force through the belly of every muscle [N]."""
        return self._core.forces()["section_force_N"]

    def wrenches(self) -> np.ndarray:
        """Force [N] and moment about the hip centre of the mesh [N m] of the tissue on each bone: array [bones, 6]."""
        return self._core.wrenches()

    def stiffness(self) -> np.ndarray:
        """Derivative of each bone's wrench by its own twist, all muscles in equilibrium: array [bones, 6, 6]."""
        return self._core.stiffness()

    def positions(self) -> np.ndarray:
        """Positions of all nodes [m]: array [nodes, 3]."""
        return self._core.positions()

    def displacements(self) -> np.ndarray:
        """Displacements of all nodes from where the mesh has them [m]: array [nodes, 3]."""
        return self._core.displacements()

    def mesh(self) -> Any:
        """The thigh where it is now, as a `meshio.Mesh` with the field `displacement_m`; `mesh.info["parts"]` names the parts."""
        cells = self._core.cells()
        n = 1 + max(int(nodes.max()) for _, _, nodes in cells if nodes.size)
        fields = {"displacement_m": self.displacements()[:n]}
        return _meshes.build(self.positions()[:n], cells, fields)

    def save(self) -> bytes:
        """The state as bytes: inputs, time and where all nodes are."""
        return self._core.save()

    def restore(self, state: bytes) -> None:
        """Takes over a state that a session of the same thigh saved; refuses any other, and then stays as it is."""
        self._core.restore(state)

    def rigid_leg(self) -> "RigidLeg":
        """The rigid leg of the same scene."""
        return RigidLeg(self)

    def follow(self, leg: "RigidLeg") -> None:
        """Takes over time, poses, movements of the bones and activations of a rigid leg."""
        self.time = leg.time
        self.set_poses(leg.poses())
        self.set_twists(leg.twists())
        self.set_activations(leg.drives())


class RigidLeg:
    """The rigid leg of a session's scene, on its way through its trial."""

    def __init__(self, thigh: Session) -> None:
        self._core = _core.RigidLeg(thigh._core, thigh._data)

    @property
    def times(self) -> np.ndarray:
        """Times of the frames [s]."""
        return self._core.times

    @property
    def time(self) -> float:
        """Time of the present frame [s]."""
        return self._core.time

    @property
    def muscles(self) -> list[str]:
        """Muscles of the thigh."""
        return self._core.muscles

    def go_to(self, seconds: float) -> None:
        """Goes to the frame nearest to a time [s]; stays where it is where there are no forces."""
        self._core.go_to(float(seconds))

    @property
    def is_feasible(self) -> bool:
        """Whether forces within their bounds carry the load."""
        return self._core.is_feasible()

    def poses(self) -> np.ndarray:
        """Poses of the bones, as `Session.set_poses` takes them."""
        return self._core.poses()

    def twists(self) -> np.ndarray:
        """How the bones move with the joint coordinates, as `Session.set_twists` takes it."""
        return self._core.twists()

    def drives(self) -> np.ndarray:
        """What drives the fibres of every muscle, as `Session.set_activations` takes it."""
        return self._core.drives()

    def angles(self) -> dict[str, float]:
        """Joint angles [rad]."""
        return self._core.angles()

    def forces(self) -> Any:
        """Table with a row per muscle of the thigh: force along the belly, and sum of the tensions of its lines [N]."""
        return table(self._core.forces())

    def lines(self) -> Any:
        """Table with a row per muscle line: force [N], activation, length [m], lever arms [m]."""
        return table(self._core.lines())

    def save(self) -> bytes:
        """The state as bytes."""
        return self._core.save()

    def restore(self, state: bytes) -> None:
        """Takes over a state that a leg of the same scene saved."""
        self._core.restore(state)
