"""Many cases, one table: each case is planned apart from the others, and what fails does not stop the rest."""

from __future__ import annotations

import csv
import multiprocessing
import os
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from ._case import Case
from ._errors import ArrayError, BonemillError
from ._plan import plan

Row = dict[str, Any]
Source = Case | str | os.PathLike[str]

TABLE = "cohort.csv"
"""The table's name in the output folder."""


def plan_cohort(
    cases: Mapping[str, Source] | Iterable[Source],
    out: str | os.PathLike[str],
    *,
    workers: int | None = None,
    client: Any = None,
    progress: Callable[[str, int, int], object] | None = None,
) -> list[Row]:
    """Plans every case, writes each plan to ``out/NAME`` and one table of all figures to ``out/cohort.csv``.

    Args:
        cases: cases or case files, by name; without names, a case is called as its file's folder.
        out: a folder; plans in it are replaced.
        workers: processes at once; default: one per core. Each plans with one thread, which changes no number.
        client: a ``distributed.Client``: the cases are planned on its cluster, whose workers must see the same files.
        progress: told ``(name, done, of)`` after each case.

    Returns:
        One row a case, in the order of the cases, as in the table: ``name``, ``outcome`` (``done``, ``fell_short`` or
        ``error``), ``why``, ``seconds``, and the plan's figures, those of tables as ``structures.facial_nerve.…``.

    Raises:
        ArrayError: two cases of one name, or a name that no folder can have.
    """
    named = _named(cases)
    home = Path(out)
    home.mkdir(parents=True, exist_ok=True)
    rows: dict[str, Row] = {}
    for row in _rows(named, home.absolute(), workers, client):
        rows[row["name"]] = row
        if progress is not None:
            progress(row["name"], len(rows), len(named))
    ordered = [rows[name] for name in named]
    _write(home / TABLE, ordered)
    return ordered


def _rows(named: Mapping[str, Source], home: Path, workers: int | None, client: Any) -> Iterator[Row]:
    if client is not None:
        from distributed import as_completed as dask_as_completed

        tasks = [client.submit(_one, name, source, home / name, pure=False) for name, source in named.items()]
        try:
            for task in dask_as_completed(tasks):
                yield task.result()
        finally:
            client.cancel(tasks)
        return
    # new processes instead of copies of this one: its threads' locks would be copied with it
    context = multiprocessing.get_context("spawn")
    most = min(workers or os.cpu_count() or 1, max(len(named), 1))
    with ProcessPoolExecutor(max_workers=most, mp_context=context) as pool:
        futures: list[Future[Row]] = [
            pool.submit(_one, name, source, home / name) for name, source in named.items()
        ]
        try:
            for future in as_completed(futures):
                yield future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _one(name: str, source: Source, home: Path) -> Row:
    """Plans one case in this process."""
    row: Row = {"name": name, "outcome": "done", "why": "", "seconds": 0.0}
    start = time.perf_counter()
    try:
        made = plan(source, threads=1)
        made.save(home)
        if made.shortfalls:
            row.update(outcome="fell_short", why="; ".join(made.shortfalls))
        row.update(_flat(made.metrics))
    except BonemillError as error:
        row.update(outcome="error", why=str(error))
    row["seconds"] = time.perf_counter() - start
    return row


def _flat(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{name}.")
        else:
            yield before + name, value


def _named(cases: Mapping[str, Source] | Iterable[Source]) -> dict[str, Source]:
    if isinstance(cases, Mapping):
        pairs = list(cases.items())
    else:
        pairs = [(_name(source), source) for source in cases]
    named: dict[str, Source] = {}
    for name, source in pairs:
        if not re.fullmatch(r"[^/\\\0]+", name) or name in (".", "..", TABLE):
            raise ArrayError(f"case name {name!r}: expected a name that a folder can have, not {TABLE}")
        if name in named:
            raise ArrayError(f"two cases are called {name!r}: give them names, {{name: case}}")
        named[name] = source
    return named


def _name(source: Source) -> str:
    path = source.path if isinstance(source, Case) else Path(source)
    return path.absolute().parent.name


def _write(path: Path, rows: list[Row]) -> None:
    columns = list(dict.fromkeys(name for row in rows for name in row))
    partial = path.with_name(f".{path.name}.partial")
    with open(partial, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, restval="")
        writer.writeheader()
        writer.writerows(rows)
    os.replace(partial, path)
