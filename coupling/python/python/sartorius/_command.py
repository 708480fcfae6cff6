"""Commands that run as a process of their own: their memory is their own, and Ctrl-C ends them at any moment."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any, Callable, Optional

from ._core import InputError, NotConverged

Progress = Callable[[str, float], None]

#: A stage that is over, as it is told on standard error.
_STAGE = re.compile(r"^(\S.*?)\s+(\d+\.\d) s$")


def options(**given: Any) -> list[str]:
    """Options of a command line; what is `None` or `False` is left away."""
    words: list[str] = []
    for name, value in given.items():
        option = "--" + name.replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            words.append(option)
        elif isinstance(value, (list, tuple)):
            words.append(option + "=" + ",".join(str(v) for v in value))
        else:
            words.append(f"{option}={os.fspath(value) if isinstance(value, os.PathLike) else value}")
    return words


def run(
    words: list[str],
    progress: Optional[Progress] = None,
    threads: Optional[int] = None,
    listen: Callable[[str], bool] = lambda line: False,
) -> "Ended":
    """Runs `sartorius` with these words.

    Raises `InputError` with the words of the program where an input is bad, and `NotConverged` where there is no solution and nothing
    was written. `KeyboardInterrupt` ends the process first. `listen` hears every line on standard error, and says whether it took it.
    """
    command = [sys.executable, "-m", "sartorius", *options(threads=threads), *words]
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stderr is not None  # both are pipes
    said: list[str] = []
    try:
        # Read beside standard error: a pipe that nobody empties stops the process.
        out: list[str] = []
        reader = threading.Thread(target=lambda pipe=process.stdout: out.append(pipe.read()), daemon=True)
        reader.start()
        for line in process.stderr:
            line = line.rstrip("\n")
            stage = _STAGE.match(line)
            if listen(line):
                continue
            if stage is None:
                said.append(line)
            elif progress is not None:
                progress(stage.group(1), float(stage.group(2)))
        reader.join()
        code = process.wait()
    except BaseException:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        raise
    text = "\n".join(said)
    notes = [line[len("note: "):] for line in said if line.startswith("note: ")]
    words_of_error = text[text.index("error: ") + len("error: "):] if "error: " in text else ""
    if code == 2:
        raise InputError(words_of_error or text)
    if code == 3 and words_of_error:
        raise NotConverged(words_of_error)
    if code not in (0, 3):
        raise RuntimeError(f"sartorius ended with exit code {code}: {text}")
    return Ended("".join(out), notes)


class Ended:
    """What a command said."""

    def __init__(self, out: str, notes: list[str]) -> None:
        self.out = out
        self.notes = notes

    def json(self) -> Any:
        """Its verdict."""
        return json.loads(self.out)


def record(folder: Path) -> dict[str, Any]:
    """`run.json` of a folder."""
    return json.loads((folder / "run.json").read_text(encoding="utf-8"))
