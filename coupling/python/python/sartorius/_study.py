"""Studies: many runs on this machine or on Dask."""

from __future__ import annotations

import os
import re
import time
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Callable, Iterator, Optional

from . import _command, _core
from ._command import options
from ._tables import read_csv

Name = str | os.PathLike[str]

#: `120 of 1500 runs   12.3 s` on standard error.
_DONE = re.compile(r"^\s*(\d+) of (\d+) runs\s+[\d.]+ s$")
#: Tasks that wait on Dask for each thread: enough that none is idle, few enough for a scheduler of a study of any size.
_WAITING = 4
#: What a task of several runs is to take [s]: a hundred times what Dask spends on it.
_TASK_SECONDS = 0.3
#: Runs of a task at most.
_MOST_RUNS = 50


@dataclass(frozen=True)
class StudyResult:
    """What a study came to. Its folder holds `table.csv`, `table.parquet`, `seconds.csv`, `report.html` and a folder per run."""

    folder: Path
    #: Runs of the study.
    runs: int
    #: Runs that have a row with a status.
    done: int
    #: Runs that are solved.
    solved: int

    @property
    def table(self) -> Any:
        """A row per run, failures included: run, subject, setting, sample, status, reason, what varies, numbers."""
        try:
            import pandas

            return pandas.read_parquet(self.folder / "table.parquet")
        except ImportError:  # neither pandas nor what reads Parquet
            return read_csv(self.folder / "table.csv")

    @property
    def indices(self) -> Any:
        """Sobol indices of every number with their standard errors, where the study asks for them (`indices = true`)."""
        return read_csv(self.folder / "indices.csv")

    @property
    def seconds(self) -> Any:
        """What every run took [s]."""
        return read_csv(self.folder / "seconds.csv")

    def _repr_html_(self) -> str:
        page = self.folder / "report.html"
        return f"<p>{self.solved} of {self.runs} runs solved: <a href='{page}'>{page}</a></p>"


def study(
    file: Name,
    *,
    out: Name | None = None,
    data: Name | None = None,
    workers: Optional[int] = None,
    scheduler: Any = None,
    resume: bool = False,
    force: bool = False,
    progress: Optional[Callable[[int, int], None]] = None,
) -> StudyResult:
    """Carries out a study file: subjects by settings by samples. The table is the same wherever it is carried out.

    Every run has a folder and a status of its own. A worker that is killed takes one run with it, which another repeats; a run without results is
    a row with its reason.

    Parameters
    ----------
    file
        Study file (TOML).
    out
        Folder of the study; `out/study-<name>` by default. On Dask every worker must see it under the same path.
    data
        Folder of the recordings and surfaces; on Dask every worker looks there.
    workers
        Worker processes, each with one thread: one per core by default. Not for a scheduler that has workers of its own.
    scheduler
        `None`: processes of this program. `"dask"`: a `LocalCluster`. An address (`"tcp://node:8786"`), a cluster of dask-jobqueue, or a
        `distributed.Client`: that.
    resume
        Go on with a study that was broken off: runs that are done are taken over.
    force
        Replace a run of another command or name in that folder.
    progress
        Called with the number of runs that are done and of all that were missing.

    Raises
    ------
    InputError
        The study cannot be carried out: all that is wrong in its file, before anything runs.
    KeyboardInterrupt
        Ctrl-C; runs that are done are kept for `resume=True`.
    """
    folder = Path(out) if out is not None else Path("out") / f"study-{Path(file).stem}"
    if scheduler is None:
        return _here(file, folder, data, workers, resume, force, progress)
    return _on_dask(file, folder.absolute(), data, workers, scheduler, resume, force, progress)


def _here(
    file: Name,
    folder: Path,
    data: Name | None,
    workers: Optional[int],
    resume: bool,
    force: bool,
    progress: Optional[Callable[[int, int], None]],
) -> StudyResult:
    def listen(line: str) -> bool:
        found = _DONE.match(line)
        if found is not None and progress is not None:
            progress(int(found.group(1)), int(found.group(2)))
        return found is not None

    words = ["study", os.fspath(file), "--json", "--out", os.fspath(folder)]
    words += options(data=data, workers=workers, resume=resume, force=force)
    verdict = _command.run(words, listen=listen).json()
    return StudyResult(folder, verdict["runs"], verdict["done"], verdict["solved"])


def _on_dask(
    file: Name,
    folder: Path,
    data: Name | None,
    workers: Optional[int],
    scheduler: Any,
    resume: bool,
    force: bool,
    progress: Optional[Callable[[int, int], None]],
) -> StudyResult:
    began = time.perf_counter()
    path = Path(file).absolute()
    found = None if data is None else os.fspath(Path(data).absolute())
    whole = _core.Study(path, found, None)
    key = whole.key()
    claimed = whole.claim(folder, resume, force)
    missing = whole.missing(key, folder)
    with _connected(scheduler, workers) as client:
        for done, _ in enumerate(_carried_out(client, (os.fspath(path), found, whole.text), key, missing, folder, whole), 1):
            if progress is not None:
                progress(done, len(missing))
    runs, done, solved = whole.collect(key, claimed, time.perf_counter() - began)
    return StudyResult(folder, runs, done, solved)


class _connected:
    """A client of whatever was given; what was made for it is closed again."""

    def __init__(self, scheduler: Any, workers: Optional[int]) -> None:
        try:
            import distributed
        except ImportError as missing:
            raise ImportError("studies on Dask need it: pip install sartorius[dask]") from missing
        self._made: list[Any] = []
        if isinstance(scheduler, distributed.Client):
            self._client = scheduler
            return
        if scheduler == "dask":
            cluster = distributed.LocalCluster(
                n_workers=workers or os.cpu_count(), threads_per_worker=1, processes=True, dashboard_address=None
            )
            self._made.append(cluster)
            scheduler = cluster
        self._client = distributed.Client(scheduler)
        self._made.append(self._client)

    def __enter__(self) -> Any:
        return self._client

    def __exit__(self, *_: Any) -> None:
        for made in reversed(self._made):
            made.close()


def _carried_out(
    client: Any, given: tuple[str, Optional[str], str], key: str, missing: list[int], folder: Path, whole: Any
) -> Iterator[int]:
    """Runs as they are done. A bounded number of tasks is on Dask at a time; runs that are short go together, each with its own folder all
    the same."""
    from distributed import as_completed
    from distributed.scheduler import KilledWorker

    waiting = iter(missing)
    tasks: dict[str, list[int]] = {}
    repeated: set[int] = set()
    together = 1

    def submit(runs: list[int]) -> Any:
        future = client.submit(_carry_out, given, key, runs, os.fspath(folder), pure=False)
        tasks[future.key] = runs
        return future

    threads = max(1, sum(client.nthreads().values()))
    pending = as_completed([submit([run]) for run in islice(waiting, _WAITING * threads)])
    for future in pending:
        runs = tasks.pop(future.key)
        try:
            seconds = future.result()
        except KilledWorker as killed:
            # A run may have waited beside the one that ended them: each is tried once more, alone.
            for run in runs:
                if run in repeated:
                    whole.note_killed(key, run, folder, f"its workers ended again and again: {killed}")
                    yield run
                else:
                    repeated.add(run)
                    pending.add(submit([run]))
            continue
        yield from runs
        # No more together than leaves each thread its share of what is left.
        together = max(1, min(_MOST_RUNS, int(_TASK_SECONDS * len(runs) / max(seconds, 1e-3)), len(missing) // (8 * threads)))
        following = list(islice(waiting, together))
        if following:
            pending.add(submit(following))


#: Studies that this worker knows.
_known: dict[tuple[str, Optional[str], str], Any] = {}


def _carry_out(given: tuple[str, Optional[str], str], key: str, runs: list[int], folder: str) -> float:
    """These runs, on a worker; returns how long they took [s]. A run that was done before writes the same again."""
    if given not in _known:
        # A worker is one of many: it has one thread.
        _core.set_threads(1)
        _known[given] = _core.Study(*given)
    study = _known[given]
    return sum(study.carry_out(key, run, folder)[1] for run in runs)
