"""What the tests share."""

import subprocess
import sys
from pathlib import Path

import pytest

#: Landmarks and strengths of the walker vary; two ways to share forces.
STUDY = """samples = 6
seed = 3

[[setting]]
name = "force"

[[setting]]
name = "activation"
keys = { "optimize.cost" = "activation" }

[[vary]]
key = "landmarks"
distribution = "normal"
sd = 5.0

[[vary]]
key = "strengths"
distribution = "normal"
sd = 0.2
"""

#: Three muscles on a coarse mesh.
SCENE = 'muscles = ["gluteus_maximus", "gluteus_medius", "gluteus_minimus"]\nresolution_mm = 20.0\n'


def command(*words: str, folder: Path) -> subprocess.CompletedProcess:
    """The command, as a process of its own."""
    return subprocess.run([sys.executable, "-m", "sartorius", *words], cwd=folder, capture_output=True, text=True)


@pytest.fixture
def study_file(tmp_path: Path) -> Path:
    file = tmp_path / "walker.toml"
    file.write_text(STUDY)
    return file


@pytest.fixture(scope="session")
def scene_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its folder keeps the calibrations of all tests."""
    file = tmp_path_factory.mktemp("scene") / "glutei.toml"
    file.write_text(SCENE)
    return file
