"""The notebook that makes the figures of the README, on a scene that is quick."""

from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
pytest.importorskip("matplotlib")

NOTEBOOK = Path(__file__).parent.parent / "notebooks" / "readme.ipynb"
CURVE = Path(__file__).parents[3] / "gait-data" / "curves" / "walker.toml"


def test_the_figures_of_the_readme(scene_file, tmp_path, monkeypatch):
    monkeypatch.setenv("SARTORIUS_NOTEBOOK_SCENE", str(scene_file))
    monkeypatch.setenv("SARTORIUS_NOTEBOOK_CURVE", str(CURVE))
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "outputs do not belong into the repository"
    client = nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}})
    client.execute()
    for figure in ["readme_forces.svg", "readme_sections.svg", "readme_cost.svg"]:
        text = (tmp_path / "out" / figure).read_text()
        assert text.count("<path") > 20, figure
