"""The user's terminal while an arm moves: nothing here waits for it."""

from __future__ import annotations

import array
import fcntl
import os
import queue
import select
import termios
import threading
import time
from contextlib import suppress


def drop_typed() -> None:
    """What was typed, or stood in a pipe or file, before a question is no answer to it."""
    # closed, or such that holds nothing
    with suppress(OSError, termios.error):
        if os.isatty(0):
            termios.tcflush(0, termios.TCIFLUSH)
            return
        count = array.array("i", [0])
        fcntl.ioctl(0, termios.FIONREAD, count)
        while count[0] > 0 and (piece := os.read(0, count[0])):
            count[0] -= len(piece)


class Screen:
    """Standard error through a thread of its own: a halted terminal (Ctrl-S) or a reader that sleeps gets its lines later."""

    def __init__(self) -> None:
        self._lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._told = self._shown = 0
        self._gone: OSError | None = None
        self._writer: threading.Thread | None = None

    def begin(self) -> None:
        if self._writer is None:
            self._writer = threading.Thread(target=self._write, daemon=True)
            self._writer.start()

    def show(self, text: str) -> None:
        """Hands on a line; may be called by a signal's handler.

        Raises:
            OSError: nobody reads standard error any more.
        """
        if self._gone is not None:
            raise self._gone
        self._told += 1
        self._lines.put(f"{text}\n".encode())

    def is_up_to_date(self) -> bool:
        return self._shown == self._told or self._gone is not None

    def catch_up(self, patience_s: float) -> None:
        """Waits until all is shown, but not longer."""
        ends = time.monotonic() + patience_s
        while not self.is_up_to_date() and time.monotonic() < ends:
            time.sleep(0.001)

    def _write(self) -> None:
        while True:
            line = self._lines.get()
            while line and self._gone is None:
                try:
                    line = line[os.write(2, line) :]
                except BlockingIOError:
                    time.sleep(0.01)
                except OSError as error:
                    self._gone = error
            self._shown += 1


SCREEN = Screen()
CATCH_UP_S = 1.0
"""A terminal gets so long for the last lines of a run."""


class Console:
    """Tells on standard error and asks on the terminal; ``yes`` answers every question."""

    def __init__(self, *, yes: bool = False) -> None:
        self._yes, self._asked, self._seen, self._typed = yes, False, False, b""
        SCREEN.begin()

    def tell(self, text: str) -> None:
        SCREEN.show(text)

    def ask(self, text: str) -> None:
        self._asked, self._seen = True, False
        SCREEN.show(f"{text} [{'yes' if self._yes else 'y/N'}]")

    def answer(self) -> bool | None:
        if not self._asked or not SCREEN.is_up_to_date():
            return None
        if self._yes:
            self._asked = False
            return True
        if not self._seen:
            drop_typed()
            self._typed = b""
        self._seen = True
        if b"\n" not in self._typed:
            if not select.select([0], [], [], 0.0)[0]:
                return None
            try:
                piece = os.read(0, 1 << 10)
            except OSError:
                # the terminal is another job's: nobody can answer
                piece = b""
            # the whole line, or all that there will be
            self._typed += piece or b"\n"
            if b"\n" not in self._typed:
                return None
        line = self._typed.partition(b"\n")[0]
        self._asked = False
        return line.strip().lower() in (b"y", b"yes")
