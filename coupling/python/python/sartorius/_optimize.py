"""The rigid leg of a trial."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import Any, Callable, Mapping, Optional, Sequence

from . import _core
from ._tables import table

#: Names of the tables of `Optimized`.
_TABLES = (
    "kinematics",
    "muscle_forces",
    "activations",
    "joint_forces",
    "joint_moments",
    "ground_reaction",
    "verdicts",
    "reserves",
    "least_violation",
)


@dataclass(frozen=True)
class Optimized:
    """What the rigid leg says of a trial. Tables have a row per reported frame and `time_s` first; units stand in the names of columns.

    Frames without solution hold NaN, and enter no curve and no statistic.
    """

    trial: str
    side: str
    mass_kg: float
    frames: int
    solved_frames: int
    #: Root mean square of the distance of markers from the model [mm].
    marker_rms_mm: float
    #: Joint angles [degrees] and marker residual [mm].
    kinematics: Any
    #: Tension of every muscle line [N].
    muscle_forces: Any
    #: Activation of every muscle line, 0 to 1.
    activations: Any
    #: Contact, ligament, tendon and bone forces [N].
    joint_forces: Any
    #: Moments that muscles must supply [N m].
    joint_moments: Any
    #: Force on the foot [N], centre of pressure [m], free moment [N m], in ground axes: x forward, y up, z to the right.
    ground_reaction: Any
    #: How every frame ended.
    verdicts: Any
    #: Reserve moments [N m]; `None` where none were asked for.
    reserves: Any = None
    #: Forces of infeasible frames [N], which are no solution; `None` where there are none.
    least_violation: Any = None
    #: What makes these results less certain than others.
    notes: Sequence[str] = ()
    #: Seconds of every stage.
    seconds: Mapping[str, float] = field(default_factory=dict)

    @property
    def is_solved(self) -> bool:
        """Whether every frame is solved."""
        return self.frames > 0 and self.solved_frames == self.frames


def optimize(
    trial: str | os.PathLike[str] | None = None,
    *,
    data: str | os.PathLike[str] | None = None,
    side: Optional[str] = None,
    form: Optional[str] = None,
    knee: Optional[str] = None,
    passive: Optional[str] = None,
    bounds: Optional[str] = None,
    cost: Optional[str] = None,
    joint_weights: Optional[str] = None,
    unbounded: Optional[bool] = None,
    reserves: Optional[float] = None,
    raise_bounds: Optional[float] = None,
    curves: Optional[str] = None,
    tendon: Optional[str] = None,
    ankle: Optional[str] = None,
    hip_centre: Optional[str] = None,
    landmarks: Optional[Mapping[str, Sequence[float]]] = None,
    strengths: Optional[Mapping[str, float]] = None,
    trial_keys: Optional[Mapping[str, Any]] = None,
    progress: Optional[Callable[[str, float], None]] = None,
) -> Optimized:
    """From markers and ground reaction to joint angles, muscle forces, activations and joint contact forces of one leg.

    Nothing is written. The numbers are those of `sartorius optimize`, to the last bit.

    Parameters
    ----------
    trial
        Trial file (TOML), or the name of a shipped trial; `None` is the built-in walker.
    data
        Folder of the recordings that the trial file names.
    side
        `"right"` or `"left"`: which leg of a trial that describes both.
    form
        The rigid leg: `"revised"` (the default) or `"published"`, by which `compare` goes. The next three change single parts.
    knee
        `"natural"` or `"implant"`, in place of the trial's.
    passive
        Passive forces that sharing knows: `"none"`, `"joints"` (measured moments), `"muscles"` (tensions of resting muscles) or `"both"`.
    bounds
        What bounds muscle forces: `"strength"` (the maximal isometric force) or `"state"` (the force at full activation at the length and
        velocity of the moment).
    cost
        What muscle forces cost: `"force"` (their squares, the default of the published leg), `"activation"` (squared activations) or
        `"volume"` (those weighted by muscle volume, the default of the revised leg).
    joint_weights
        What joint forces cost: `"table"` (the published weights, the default of the published leg) or `"none"` (that of the revised one).
    unbounded
        `True`: no upper bounds on muscle forces, the published form.
    reserves
        Weight of squared reserve moments on every joint coordinate, in 1/(N m)². `None`: no reserves.
    raise_bounds
        Where a frame is infeasible, raise all strengths by up to this factor, at least 1; the frame stays unsolved, and
        `least_violation` tells the forces.
    curves
        Muscle curves for activations: `"thelen"` (the default) or `"degroote"`.
    tendon
        Tendons for activations: `"elastic"` (the default) or `"rigid"`.
    ankle
        `"universal"` or `"parallel"`, in place of the trial's.
    hip_centre
        `"table"`, `"regression"` or `"harrington"`, in place of the trial's.
    landmarks
        Landmarks that sit elsewhere: name to shift along three axes in mm, in the local frame of the markers of the segment. Names are
        `right_asis`, `left_asis`, `right_psis`, `left_psis`, `hip_centre`, `lateral_epicondyle`, `medial_epicondyle`,
        `lateral_malleolus`, `medial_malleolus`, `heel`, `metatarsal_1`, `metatarsal_5`.
    strengths
        Muscle line to factor on its strength, at least 0.
    trial_keys
        Keys of the trial file in place of its own, sections with dots: `{"filter.motion_hz": 6.0}`.
    progress
        Called as each stage ends, with its name and its seconds.

    Returns
    -------
    Optimized
        Tables are `pandas.DataFrame`s, or dictionaries of columns where pandas is not installed.

    Raises
    ------
    InputError
        An input cannot be used; the message names file, place, value and remedy, all mistakes at once.
    NotConverged
        The input is good, but there is no solution at all. Single frames without solution raise nothing: look at `is_solved`.
    KeyboardInterrupt
        Ctrl-C is heard at once.

    Examples
    --------
    >>> import sartorius
    >>> walker = sartorius.optimize()
    >>> walker.is_solved
    True
    >>> float(walker.joint_forces["knee_medial_N"].max()) > 500.0
    True
    """
    options = dict(
        form=form,  # before those that change parts of it
        knee=knee,
        passive=passive,
        bounds=bounds,
        cost=cost,
        joint_weights=joint_weights,
        unbounded=unbounded,
        reserves=reserves,
        raise_bounds=raise_bounds,
        curves=curves,
        tendon=tendon,
        ankle=ankle,
        hip_centre=hip_centre,
    )
    shifts = None if landmarks is None else {name: [float(v) for v in shift] for name, shift in landmarks.items()}
    factors = None if strengths is None else {name: float(factor) for name, factor in strengths.items()}
    keys = None if trial_keys is None else dict(trial_keys)
    told = _core.optimize(trial, data, side, options, shifts, factors, keys, progress)
    return Optimized(**{name: table(value) if name in _TABLES else value for name, value in told.items()})
