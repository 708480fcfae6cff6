"""Tables as pandas has them, or plain where it is not installed."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any, Mapping

import numpy as np


def _pandas() -> Any:
    """pandas, or `None`: tables are dictionaries of columns then. Not loaded before there is a table, as it takes longer than most commands."""
    try:
        import pandas
    except ImportError:
        return None
    return pandas


def table(columns: Mapping[str, Any]) -> Any:
    """A `pandas.DataFrame` of the columns; a dictionary of them where pandas is not installed."""
    pandas = _pandas()
    return dict(columns) if pandas is None else pandas.DataFrame(dict(columns))


def read_csv(file: Path) -> Any:
    """The table in a CSV file; numbers read back to the last bit."""
    pandas = _pandas()
    if pandas is not None:
        # What pandas 3 does by itself.
        exact = {"float_precision": "round_trip"} if int(pandas.__version__.split(".")[0]) < 3 else {}
        return pandas.read_csv(file, **exact)
    with open(file, newline="") as text:
        rows = list(csv.reader(text))
    columns = {name: [row[i] for row in rows[1:]] for i, name in enumerate(rows[0])}
    return {name: _numbers(cells) for name, cells in columns.items()}


def _numbers(cells: list[str]) -> Any:
    try:
        return np.array([float(cell) if cell else np.nan for cell in cells])
    except ValueError:
        return cells
