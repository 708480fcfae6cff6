"""Commands that leave a folder."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import sartorius


@pytest.fixture(scope="module")
def glutei(scene_file):
    stages = []
    done = sartorius.compare(
        scene_file,
        out=scene_file.parent / "out",
        contact="without",
        threads=2,
        progress=lambda stage, seconds: stages.append(stage),
    )
    assert stages[:3] == ["rigid leg", "mesh", "calibration"] and stages[-1] == "write"
    return done


def test_a_comparison_is_tables_and_meshes(glutei):
    assert glutei.is_solved and glutei.reason is None
    forces = glutei.forces
    assert set(forces["muscle"]) == {"gluteus_maximus", "gluteus_medius", "gluteus_minimus"}
    row = forces[(forces["step"] == "loading_response") & (forces["muscle"] == "gluteus_medius")].iloc[0]
    assert abs(row["fe_no_contact_N"] / row["rigid_N"] - 1.0) < 0.1
    section = glutei.quantities.query("quantity == 'section_force_N' and step == 'loading_response'")
    np.testing.assert_allclose(section.set_index("of")["value"]["gluteus_medius"], row["fe_no_contact_N"], atol=1e-3)
    mesh = glutei.mesh(library="meshio")
    assert len(mesh.points) > 1000 and np.isfinite(mesh.points).all()
    assert glutei.record["command"] == "compare" and len(glutei.explanation) == 6


def test_a_session_of_the_same_scene_pulls_with_the_same_forces(glutei, scene_file):
    thigh = sartorius.Session(scene_file, contact=False, cache=scene_file.parent / "calibration-cache")
    leg = thigh.rigid_leg()
    section = glutei.quantities.query("quantity == 'section_force_N'").set_index(["step", "of"])["value"]
    times = leg.times
    thigh.solve()
    # The steps of `compare`: heel strike, and 12 % of the cycle.
    for step, time_s in [("heel_strike", times[0]), ("loading_response", times[round(0.12 * (len(times) - 1))])]:
        leg.go_to(time_s)
        thigh.follow(leg)
        thigh.solve()
        for muscle, force in zip(thigh.muscles, thigh.section_forces):
            # Two ways to the same equilibrium, each settled to the 0.1 N of the scene.
            assert abs(force - section[step, muscle]) < 0.5, (step, muscle, force, section[step, muscle])


def test_plan_and_mesh(tmp_path):
    expected = sartorius.plan("three_muscles")
    assert expected["elements"] > 500 and expected["expected_memory_mib"] > 10
    made = sartorius.mesh(resolution=20, only=["sartorius"], out=tmp_path / "mesh")
    assert made.is_solved and made.quality["muscle"].tolist() == ["sartorius"]
    assert len(made.mesh(library="meshio").points) > 100


def test_a_folder_of_mine_is_never_replaced(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(sartorius.InputError, match="mine.txt"):
        sartorius.mesh(resolution=20, only=["sartorius"], out=tmp_path)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("call", ["sartorius.compare(out='out')", "[sartorius.optimize() for _ in range(10000)]"])
def test_ctrl_c_is_heard(tmp_path, call):
    program = f"import sartorius\nprint('begun', flush=True)\ntry:\n    {call}\nexcept KeyboardInterrupt:\n    print('heard', flush=True)\n"
    process = subprocess.Popen(
        [sys.executable, "-c", program], cwd=tmp_path, stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stdout.readline() == "begun\n"
    time.sleep(2.0)
    begun = time.monotonic()
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    assert process.communicate(timeout=20)[0] == "heard\n"
    assert time.monotonic() - begun < 5.0
    # No process of the group goes on.
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)
