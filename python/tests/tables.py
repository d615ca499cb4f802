"""Structured arrays against each other and against the command's files."""

import csv
from pathlib import Path

import numpy as np


def same_rows(a: np.ndarray, b: np.ndarray) -> None:
    assert a.dtype == b.dtype
    for name in a.dtype.names or ():
        np.testing.assert_array_equal(a[name], b[name], name)


def same_as_file(rows: np.ndarray, path: Path) -> None:
    """Every column and cell; "" is NaN or no text."""
    with open(path, newline="") as file:
        lines = list(csv.DictReader(file))
    assert list(lines[0]) == list(rows.dtype.names or ())
    for name in lines[0]:
        column = rows[name]
        for cell, value in zip((line[name] for line in lines), column, strict=True):
            if column.dtype.kind == "U":
                assert cell == value
            elif cell == "":
                assert np.isnan(value)
            else:
                assert float(cell) == value, name
