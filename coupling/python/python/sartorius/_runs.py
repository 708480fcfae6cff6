"""Commands that leave a folder: compare, cost, mesh, plan."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Mapping, Optional, Sequence

from . import _command, _meshes
from ._command import Progress, options
from ._tables import read_csv

Name = str | os.PathLike[str]


def _stem(given: Name | None, default: str) -> str:
    return default if given is None else Path(given).stem


def _folder(out: Name | None, command: str, name: str) -> Path:
    return Path(out) if out is not None else Path("out") / f"{command}-{name}"


@dataclass(frozen=True)
class Run:
    """A run that left a folder. Every file in it is described in docs/columns.md."""

    folder: Path
    #: `solved` or `not_converged`.
    status: str
    #: Why it is not solved.
    reason: Optional[str]
    #: What the reader must know: doubts about the input, warnings about the mesh.
    notes: Sequence[str]
    #: Seconds of every stage.
    seconds: Mapping[str, float]

    @property
    def is_solved(self) -> bool:
        """Whether everything is solved."""
        return self.status == "solved"

    def table(self, name: str) -> Any:
        """A table of the folder by the name of its file without ending."""
        return read_csv(self.folder / f"{name}.csv")

    @property
    def record(self) -> dict[str, Any]:
        """`run.json`: verdict, program, machine, settings, inputs, and what computes the same again."""
        return _command.record(self.folder)

    def _repr_html_(self) -> str:
        return f"<p>{self.status}: <a href='{self.folder / 'report.html'}'>{self.folder / 'report.html'}</a></p>"


def _run(kind: type, folder: Path, ended: _command.Ended) -> Any:
    record = _command.record(folder)
    notes = [*record.get("notes", []), *(note for note in ended.notes if note not in record.get("notes", []))]
    return kind(folder, record["status"], record["reason"], notes, record["seconds"])


@dataclass(frozen=True)
class Comparison(Run):
    """Heel strike and loading response on the deformable thigh beside the rigid leg."""

    @property
    def forces(self) -> Any:
        """Force through the belly of every muscle at every step [N]: of the rigid leg, of the thigh without and with contact."""
        return self.table("comparison")

    @property
    def quantities(self) -> Any:
        """Every number of every step: section forces [N], bone and contact forces [N], stresses [kPa], common volume [cm³]."""
        return self.table("quantities")

    @property
    def explanation(self) -> Any:
        """Why each muscle differs from the rigid leg's."""
        return self.table("explanation")

    def mesh(self, contact: bool = False, frame: int = -1, library: str | None = None) -> Any:
        """The thigh at a frame (the last one by default), with displacements, stresses and fibre stretch; coordinates in m.

        `library`: `"pyvista"` or `"meshio"`; by default the one that is installed, pyvista first.
        """
        files = sorted((self.folder / ("contact" if contact else "no_contact")).glob("*.vtu"))
        files = [file for file in files if file.stem.startswith("thigh_")]
        if not files:
            raise FileNotFoundError(f"{self.folder} holds no frames {'with' if contact else 'without'} contact")
        return _meshes.read(files[frame], library)


def compare(
    scene: Name | None = None,
    *,
    out: Name | None = None,
    data: Name | None = None,
    resolution: Optional[float] = None,
    stress_free: Optional[str] = None,
    contact: Optional[str] = None,
    only: Optional[Sequence[str]] = None,
    two_way: Optional[str] = None,
    passes: Optional[int] = None,
    accuracy: Optional[float] = None,
    resume: bool = False,
    force: bool = False,
    threads: Optional[int] = None,
    progress: Optional[Progress] = None,
) -> Comparison:
    """Heel strike and loading response on the deformable thigh beside the rigid leg: `sartorius compare` as a process of its own.

    Parameters
    ----------
    scene
        Scene file (TOML), or the name of a shipped scene (`three_muscles`); `None` is the built-in walker.
    out
        Folder for the results; `out/compare-<scene>` by default. Calibrations are kept beside it.
    data
        Folder of the recordings and surfaces that the scene names.
    resolution
        Length of edges that is aimed at, in mm, in place of the scene's.
    stress_free
        `"standing"` or `"heel-strike"`: posture in which the mesh is free of stress.
    contact
        `"both"`, `"with"` or `"without"`.
    only
        Names of muscles, in place of the scene's.
    two_way
        `"iqn-ils"`, `"aitken"` or `"relaxation"`: feed forces and lever arms back into force sharing.
    passes
        Passes of two-way coupling at most.
    accuracy
        Take the cheapest setting whose section forces are within so many percent of the finest one's.
    resume
        Go on with a run of the same scene that was broken off.
    force
        Replace a run of another scene in that folder.
    threads
        Threads to use; all cores by default. Results do not depend on it.
    progress
        Called as each stage ends, with its name and its seconds.

    Raises
    ------
    InputError
        An input cannot be used; nothing was written.
    NotConverged
        There is no solution, and nothing was written. A step without solution raises nothing: look at `is_solved` and `reason`.
    KeyboardInterrupt
        Ctrl-C ends the process; solved frames are kept for `resume=True`.
    """
    folder = _folder(out, "compare", _stem(scene, "walker"))
    words = ["compare"] + ([] if scene is None else [os.fspath(scene)]) + ["--json", "--out", os.fspath(folder)]
    words += options(
        data=data,
        resolution=resolution,
        stress_free=stress_free,
        contact=contact,
        only=only,
        two_way=two_way,
        passes=passes,
        accuracy=accuracy,
        resume=resume,
        force=force,
    )
    return _run(Comparison, folder, _command.run(words, progress, threads))


def plan(scene: Name | None = None, *, data: Name | None = None, exact: bool = False) -> dict[str, Any]:
    """What a scene would simulate, what it leaves out and why, and what it would cost: unknowns, memory in MiB, seconds.

    `exact`: make the mesh and count on it, which takes as long as that does.
    """
    words = ["plan"] + ([] if scene is None else [os.fspath(scene)]) + ["--json"]
    return _command.run(words + options(data=data, exact=exact)).json()


@dataclass(frozen=True)
class Costs(Run):
    """What accuracy costs in time."""

    @property
    def settings(self) -> Any:
        """What every setting took, and how far its section forces are from the finest ones [%]."""
        return self.table("cost")

    @property
    def axes(self) -> Any:
        """How the error falls along every axis."""
        return self.table("axes")

    @property
    def errors(self) -> Any:
        """How sure every number is, by who owns the error."""
        return self.table("errors")


def cost(
    ladder: Name | None = None,
    *,
    scene: Name | None = None,
    only: Optional[Sequence[str]] = None,
    out: Name | None = None,
    data: Name | None = None,
    resume: bool = False,
    force: bool = False,
    threads: Optional[int] = None,
    progress: Optional[Progress] = None,
) -> Costs:
    """What accuracy costs in time: a ladder of settings from coarse to fine, each a process of its own.

    `ladder`: ladder file (TOML), or the name of a shipped one; `scene`: in place of the ladder's; `only`: names of axes. The other
    parameters are those of `compare`, and so is what is raised.
    """
    name = _stem(scene if scene is not None else ladder, "walker")
    folder = _folder(out, "cost", name)
    words = ["cost"] + ([] if ladder is None else [os.fspath(ladder)]) + ["--json", "--out", os.fspath(folder)]
    words += options(scene=scene, only=only, data=data, resume=resume, force=force)
    return _run(Costs, folder, _command.run(words, progress, threads))


@dataclass(frozen=True)
class Mesh(Run):
    """Hexahedral meshes of the muscles."""

    @property
    def quality(self) -> Any:
        """Elements, shape, volume and distances of every muscle."""
        return self.table("quality")

    def mesh(self, library: str | None = None) -> Any:
        """Muscles and bones as one mesh; coordinates in m. `library`: `"pyvista"` or `"meshio"`."""
        return _meshes.read(next(self.folder.glob("*.vtu")), library)


def mesh(
    source: Name | None = None,
    *,
    resolution: float = 6.0,
    bones: Name | None = None,
    ends: Name | None = None,
    unit: Optional[str] = None,
    subject: Name | None = None,
    data: Name | None = None,
    only: Optional[Sequence[str]] = None,
    out: Name | None = None,
    force: bool = False,
    threads: Optional[int] = None,
    progress: Optional[Progress] = None,
) -> Mesh:
    """Hexahedral meshes of muscles, kept apart from each other and from bones, with a table of their quality.

    Parameters
    ----------
    source
        Table of muscle sections (CSV), or a folder of closed muscle surfaces; `None` is the built-in thigh.
    resolution
        Length of edges that is aimed at, in mm.
    bones
        Table of bone sections, or a folder of bone surfaces.
    ends
        For surfaces: which muscles to mesh and which bones they join (CSV with the columns muscle, end, bone).
    unit
        For surfaces: `"m"` or `"mm"`.
    subject
        Trial whose subject the built-in thigh is made as large as.
    only
        Names of muscles.

    The other parameters are those of `compare`, and so is what is raised.
    """
    folder = _folder(out, "mesh", _stem(source, "thigh"))
    words = ["mesh"] + ([] if source is None else [os.fspath(source)]) + ["--json", "--out", os.fspath(folder)]
    words += options(
        resolution=resolution, bones=bones, ends=ends, unit=unit, subject=subject, data=data, only=only, force=force
    )
    return _run(Mesh, folder, _command.run(words, progress, threads))
