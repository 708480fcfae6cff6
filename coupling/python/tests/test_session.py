"""The thigh by itself: state and results hang on what was given alone."""

import numpy as np
import pytest
import sartorius


@pytest.fixture(scope="module")
def thigh(scene_file):
    return sartorius.Session(scene_file, contact=False, cache=scene_file.parent / "calibration-cache")


def test_a_restored_state_goes_on_to_the_same_bits(thigh):
    thigh.set_activations({"gluteus_medius": 0.3})
    thigh.solve()
    state = thigh.save()
    before = thigh.section_forces

    def onwards():
        thigh.set_activations([0.2, 0.4, 0.0])
        thigh.solve()
        return thigh.forces(), thigh.positions(), thigh.wrenches()

    first = onwards()
    assert np.abs(thigh.section_forces - before).max() > 10.0
    thigh.restore(state)
    np.testing.assert_array_equal(thigh.section_forces, before)
    second = onwards()
    assert first[0].equals(second[0])
    np.testing.assert_array_equal(first[1], second[1])
    np.testing.assert_array_equal(first[2], second[2])


def test_shapes_and_balance(thigh):
    assert thigh.muscles == ["gluteus_maximus", "gluteus_medius", "gluteus_minimus"]
    assert thigh.positions().shape == thigh.displacements().shape == (thigh.n_nodes, 3)
    thigh.set_activations([0.1, 0.5, 0.2])
    thigh.solve()
    wrenches = thigh.wrenches()
    assert wrenches.shape == (len(thigh.bones), 6)
    # Nothing but bones holds the muscles: what they pull with adds up to nothing, to the residual of the scene.
    assert np.abs(wrenches[:, :3].sum(axis=0)).max() < 0.2 and np.abs(wrenches).max() > 50.0
    assert thigh.stiffness().shape == (len(thigh.bones), 6, 6)
    mesh = thigh.mesh()
    assert len(mesh.info["parts"]) == len(mesh.cells)
    np.testing.assert_array_equal(mesh.points, thigh.positions()[: len(mesh.points)])
    table = thigh.forces()
    np.testing.assert_allclose(table["fibre_N"] + table["matrix_N"] + table["shell_N"], table["section_force_N"], atol=1e-6)


def test_what_cannot_be_given_is_refused_and_changes_nothing(thigh):
    state = thigh.save()
    rest = np.tile([0, 0, 0, 1, 0, 0, 0.0], (len(thigh.bones), 1))
    bent = rest.copy()
    bent[1, 3] = 0.5
    for give, words in [
        (lambda: thigh.set_activations([0.1, 0.2]), "must be 3"),
        (lambda: thigh.set_activations([0.1, np.nan, 0.2]), "nan|NaN"),
        (lambda: thigh.set_activations([0.1, -0.5, 0.2]), "-0.5"),
        (lambda: thigh.set_activations({"soleus": 0.1}), "no muscle soleus"),
        (lambda: thigh.set_poses(rest[:2]), "must be 4"),
        (lambda: thigh.set_poses(rest[:, :6]), "must be 7"),
        (lambda: thigh.set_poses(bent), "length 0.5"),
        (lambda: thigh.restore(b"rubbish"), "no state"),
        (lambda: thigh.restore(state[:-8]), "damaged or incomplete"),
    ]:
        with pytest.raises(sartorius.InputError, match=words):
            give()
    assert thigh.save() == state
