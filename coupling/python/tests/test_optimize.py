"""The rigid leg: the numbers of the command, its words, and what the package promises around them."""

import ast
import doctest
import inspect
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import sartorius
from conftest import command
from sartorius._tables import read_csv


def test_the_numbers_are_those_of_the_command(tmp_path):
    ended = command("optimize", "--cost", "activation", "--tendon", "rigid", "--out", "out", folder=tmp_path)
    assert ended.returncode == 0, ended.stderr
    walker = sartorius.optimize(cost="activation", tendon="rigid")
    assert walker.is_solved and walker.frames == 101 and walker.trial == "walker"
    for name in ["kinematics", "muscle_forces", "activations", "joint_forces", "joint_moments", "ground_reaction"]:
        written = read_csv(tmp_path / "out" / f"{name}.csv")
        told = getattr(walker, name)
        assert list(told.columns) == list(written.columns)
        np.testing.assert_array_equal(told.to_numpy(), written.to_numpy(), err_msg=name)
    assert (walker.verdicts["status"] == "solved").all() and walker.verdicts["kkt_residual"].max() < 1e-6


def test_errors_have_the_words_of_the_core(tmp_path):
    for words, call in [
        (["optimize", "DM_ngait_og33"], lambda: sartorius.optimize("DM_ngait_og33")),
        (["optimize", "DM_ngait_og3", "--data", "."], lambda: sartorius.optimize("DM_ngait_og3", data=".")),
        (["plan", "three_muscle"], lambda: sartorius.plan("three_muscle")),
        (["compare", "--resolution", "99"], lambda: sartorius.compare(resolution=99, out=tmp_path / "x")),
    ]:
        ended = command(*words, folder=tmp_path)
        assert ended.returncode == 2
        with pytest.raises(sartorius.InputError) as raised:
            call()
        assert str(raised.value).split() == ended.stderr.removeprefix("error: ").split()
        assert isinstance(raised.value, ValueError)


def test_all_mistakes_of_a_call_are_named_at_once():
    with pytest.raises(sartorius.InputError) as raised:
        sartorius.optimize(cost="forces", raise_bounds=0.5, strengths={"solus": 1.0}, landmarks={"heal": [0, 0, 1]})
    for words in ["cost is", "raise_bounds is 0.5", "did you mean `soleus`?", "did you mean `heel`?"]:
        assert words in str(raised.value)
    for wrong in [math.nan, math.inf, -1.0]:
        with pytest.raises(sartorius.InputError, match="strengths"):
            sartorius.optimize(strengths={"soleus": wrong})
    with pytest.raises(sartorius.InputError, match="no number"):
        sartorius.optimize(landmarks={"heel": [math.nan, 0, 0]})
    with pytest.raises(sartorius.InputError, match="no trial file"):
        sartorius.optimize(trial_keys={"filter.motion_hz": 6.0})


def test_a_muscle_that_is_too_weak_makes_frames_without_forces():
    weak = sartorius.optimize(strengths={name: 0.02 for name in sartorius.optimize().muscle_forces.columns[1:].str[:-2]})
    assert not weak.is_solved and weak.solved_frames < weak.frames
    unsolved = weak.verdicts["status"] != "solved"
    assert weak.muscle_forces[unsolved].iloc[:, 1:].isna().all().all()
    assert weak.verdicts.loc[unsolved, "reason"].str.len().min() > 10


def test_shifted_landmarks_move_the_leg_and_come_back():
    there = sartorius.optimize(landmarks={"lateral_epicondyle": [0, 5, 0], "hip_centre": [0, 0, 5]})
    here = sartorius.optimize(landmarks={})
    assert abs(there.joint_forces["knee_medial_N"].max() - here.joint_forces["knee_medial_N"].max()) > 1.0
    pd.testing.assert_frame_equal(here.joint_forces, sartorius.optimize().joint_forces, check_exact=True)


def test_progress_is_told_and_its_errors_come_through():
    stages = []
    walker = sartorius.optimize(progress=lambda stage, seconds: stages.append((stage, seconds)))
    assert [stage for stage, _ in stages] == list(walker.seconds) and all(seconds >= 0 for _, seconds in stages)

    def fails(stage, seconds):
        raise RuntimeError("mine")

    with pytest.raises(RuntimeError, match="mine"):
        sartorius.optimize(progress=fails)


def test_help_is_enough_to_use_it():
    words = inspect.getdoc(sartorius.optimize)
    parameters = inspect.signature(sartorius.optimize).parameters
    assert all(f"{name}\n" in words for name in parameters), [n for n in parameters if f"{n}\n" not in words]
    for unit in ["mm", "N m", "factor"]:
        assert unit in words
    for name in sartorius.__all__:
        assert inspect.getdoc(getattr(sartorius, name)), name
    tried = doctest.run_docstring_examples  # the examples of the help are run
    failed = doctest.testmod(sartorius._optimize).failed + doctest.testmod(sartorius).failed
    assert tried and failed == 0


def test_stubs_name_what_is_there_and_nothing_else():
    core = sartorius._core
    tree = ast.parse((Path(sartorius.__file__).parent / "_core.pyi").read_text())
    public = lambda names: {name for name in names if not name.startswith("_")}
    functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
    assert public(dir(core)) == functions | public(classes)
    for name, node in classes.items():
        if name in public(classes) and not issubclass(getattr(core, name), Exception):
            written = {item.name for item in node.body if isinstance(item, ast.FunctionDef)}
            assert public(dir(getattr(core, name))) == public(written), name
