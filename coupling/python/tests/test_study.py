"""Studies here and on Dask: the same table, whoever carried it out and whoever was killed."""

import os
import signal
import time

import pandas as pd
import pytest
import sartorius
from conftest import STUDY
from sartorius._tables import read_csv

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster


def test_dask_and_this_machine_make_the_same_table(study_file, tmp_path, cluster):
    steps = []
    here = sartorius.study(study_file, out=tmp_path / "here", workers=2)
    dask = sartorius.study(study_file, out=tmp_path / "dask", scheduler=cluster, progress=lambda *of: steps.append(of))
    assert (here.runs, here.done, here.solved) == (dask.runs, dask.done, dask.solved) == (12, 12, 12)
    assert steps == [(k, 12) for k in range(1, 13)]
    for name in ["table.csv", "table.parquet", "report.html"]:
        assert (here.folder / name).read_bytes() == (dask.folder / name).read_bytes(), name
    table = here.table
    csv = read_csv(here.folder / "table.csv")
    assert list(table.columns) == list(csv.columns) and len(table) == 12
    numbers = [name for name in csv.columns if csv[name].dtype == float and name != "reason"]
    assert len(numbers) > 100
    pd.testing.assert_frame_equal(table[numbers], csv[numbers], check_exact=True)
    # A run is what `optimize` computes with the values of its row.
    row = table[table["setting"] == "activation"].iloc[2]
    strengths = {name.split(".")[1]: row[name] for name in csv.columns if name.startswith("strengths.")}
    landmarks = {}
    for name in csv.columns:
        if name.startswith("landmarks."):
            landmarks.setdefault(name.split(".")[1], []).append(row[name])
    alone = sartorius.optimize(cost="activation", strengths=strengths, landmarks=landmarks)
    assert alone.muscle_forces["soleus_N"].max() == row["peak_soleus_N"]


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_killed_worker_loses_nothing_and_doubles_nothing(tmp_path, cluster):
    file = tmp_path / "many.toml"
    file.write_text(STUDY.replace("samples = 6", "samples = 20"))
    whole = sartorius.study(file, out=tmp_path / "whole", workers=2)
    killed = []

    def kill(done, of):
        if done == 5:
            killed.append(next(iter(cluster.workers.values())).pid)
            os.kill(killed[0], signal.SIGKILL)

    with distributed.Client(cluster) as client:
        client.wait_for_workers(2)
        dask = sartorius.study(file, out=tmp_path / "dask", scheduler=client, progress=kill)
        client.wait_for_workers(2, timeout=60)
        assert killed and all(worker.pid != killed[0] for worker in cluster.workers.values())
    assert dask.done == 40
    assert (whole.folder / "table.csv").read_bytes() == (dask.folder / "table.csv").read_bytes()


def test_a_broken_off_study_goes_on(study_file, tmp_path, cluster):
    class Stop(Exception):
        pass

    def stop(done, of):
        if done == 5:
            raise Stop

    out = tmp_path / "out"
    with pytest.raises(Stop):
        sartorius.study(study_file, out=out, scheduler=cluster, progress=stop)
    assert not (out / "run.json").exists()
    time.sleep(2.0)  # runs that were begun end
    done = {file: file.stat().st_mtime_ns for file in out.glob("runs/*/*/run.json")}
    assert len(done) >= 5
    resumed = sartorius.study(study_file, out=out, scheduler=cluster, resume=True)
    assert resumed.solved == 12
    assert all(file.stat().st_mtime_ns == written for file, written in done.items())


def test_a_worker_without_the_data_is_a_row_with_the_path(tmp_path, cluster):
    file = tmp_path / "elsewhere.toml"
    file.write_text('[[subject]]\nname = "DM"\ntrial = "DM_ngait_og3"\n\n[[setting]]\nname = "base"\n')
    done = sartorius.study(file, out=tmp_path / "out", data=tmp_path, scheduler=cluster)
    assert (done.runs, done.done, done.solved) == (1, 1, 0)
    row = done.table.iloc[0]
    assert row["status"] == "refused" and os.fspath(tmp_path) in row["reason"], row["reason"]


def test_mistakes_are_named_before_anything_runs(tmp_path, cluster):
    file = tmp_path / "wrong.toml"
    file.write_text(STUDY.replace("optimize.cost", "optimize.costs"))
    for scheduler in [None, cluster]:
        with pytest.raises(sartorius.InputError, match="did you mean `optimize.cost`"):
            sartorius.study(file, out=tmp_path / "out", scheduler=scheduler)
    assert not (tmp_path / "out").exists()
