"""Sartorius: a rigid lower limb coupled with a deformable finite-element thigh.

>>> import sartorius
>>> walker = sartorius.optimize()              # the rigid leg: angles, forces, activations
>>> walker.joint_forces                        # doctest: +SKIP
>>> sartorius.compare("three_muscles")         # doctest: +SKIP
>>> sartorius.study("study.toml")              # doctest: +SKIP

`optimize` is the rigid leg of a trial, `compare` sets the deformable thigh beside it, `plan` says what that would take, `cost` what accuracy
costs, `mesh` makes meshes. `Session` drives the thigh step by step. `study` carries out many runs, here or on Dask.

Units stand in names: `_N`, `_mm`, `_deg`, `_s`; everything without one is SI. Axes are x forward, y up, z to the right, of a right leg.
"""

import sys as _sys

from . import _core
from ._core import InputError, NotConverged, __version__, set_threads
from ._optimize import Optimized, optimize
from ._runs import Comparison, Costs, Mesh, Run, compare, cost, mesh, plan
from ._session import RigidLeg, Session
from ._study import StudyResult, study

__all__ = [
    "Comparison",
    "Costs",
    "InputError",
    "Mesh",
    "NotConverged",
    "Optimized",
    "RigidLeg",
    "Run",
    "Session",
    "StudyResult",
    "compare",
    "cost",
    "mesh",
    "optimize",
    "plan",
    "set_threads",
    "study",
]

# Processes of this program are started as this one is: by this interpreter.
_core.is_started_by([_sys.executable, "-m", "sartorius"], _core.__file__)
