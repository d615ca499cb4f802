"""What tests of streaming share: an operator that agrees, and a run over the real client that comes as far as its fault."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ur_double import Double

from bonemill.stream import Report, Settings, Streaming, UrLink

STALL = "ms old"
"""A busy machine stalls, which stops a run like any other fault; it is resumed."""
TRIES = 6


class Yes:
    """Says yes to everything and remembers what it was told; something may be done before it answers the first question."""

    def __init__(self, before: Callable[[], None] = lambda: None) -> None:
        self.told: list[str] = []
        self.asked: list[str] = []
        self._before, self._open = before, False

    def tell(self, text: str) -> None:
        self.told.append(text)

    def ask(self, text: str) -> None:
        self.asked.append(text)
        self._open = True

    def answer(self) -> bool | None:
        was, self._open = self._open, False
        if was and len(self.asked) == 1:
            self._before()
        return True if was else None


def ready(folder: Path, **how: Any) -> Streaming:
    return Streaming(folder, **({"slow": True, "payload_kg": 1.0, "run_up_s": 0.1} | how))


def run_with(streaming: Streaming, double: Double, operator: Yes) -> Report:
    return streaming.run(UrLink(double.host, streaming.period_s, Settings()), operator)
