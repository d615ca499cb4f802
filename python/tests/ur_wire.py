"""One connection of the double, and what a network may do to it: delays, stalls, cuts, packets twice or in another order.

Bytes become messages in the double; a `Line` holds messages of one direction until they are due. Like TCP it keeps the
order unless it is told to mix it, and a stall holds everything and then lets it go at once.
"""

from __future__ import annotations

import random
import socket
import struct
from collections import deque
from dataclasses import dataclass, field

FOREVER_S = float("inf")


@dataclass
class Weather:
    """What happens to the messages of a kind of connection; times are s."""

    delay_s: float = 0.0
    jitter_s: float = 0.0
    stalled_until_s: float = 0.0
    twice: float = 0.0
    """Share of the data messages that come twice."""
    mixed: float = 0.0
    """Share of the data messages that change places with the one before."""
    deaf: bool = False
    """What the client sends is lost, and it is not told."""


class Line:
    """Messages under way in one direction."""

    def __init__(self, weather: Weather, dice: random.Random) -> None:
        self._weather, self._dice = weather, dice
        self._waiting: deque[tuple[float, bytes]] = deque()

    def put(self, now_s: float, message: bytes, *, data: bool) -> None:
        weather = self._weather
        due_s = now_s + weather.delay_s + weather.jitter_s * self._dice.random()
        if self._waiting and not (data and self._dice.random() < weather.mixed):
            due_s = max(due_s, self._waiting[-1][0])
        elif self._waiting:
            # before the one that is still under way
            last_s, last = self._waiting.pop()
            self._waiting.append((last_s, message))
            message, due_s = last, max(due_s, last_s)
        self._waiting.append((due_s, message))
        if data and self._dice.random() < weather.twice:
            self._waiting.append((due_s, message))

    def due(self, now_s: float) -> list[bytes]:
        """What has arrived by now."""
        # a packet can only be overtaken by the next one if it waits for it
        wait_s = 0.004 if self._weather.mixed else 0.0
        if now_s < self._weather.stalled_until_s:
            return []
        arrived = []
        while self._waiting and self._waiting[0][0] + wait_s <= now_s:
            arrived.append(self._waiting.popleft()[1])
        return arrived


@dataclass
class Connection:
    """A socket with its role; `role` is control, receive, io, script or dashboard."""

    socket: socket.socket
    role: str
    weather: Weather
    dice: random.Random
    text: bytes = b""
    recipes: dict[int, list[str]] = field(default_factory=dict)
    outputs: list[str] = field(default_factory=list)
    code: str = ""
    period_s: float = 0.008
    due_s: float = FOREVER_S
    """When the next state is sent."""
    closed: bool = False

    def __post_init__(self) -> None:
        self.inbound = Line(self.weather, self.dice)
        self.outbound = Line(self.weather, self.dice)
        self._unsent = b""

    def into(self, weather: Weather) -> None:
        """Another role has another weather."""
        self.weather = self.inbound._weather = self.outbound._weather = weather

    def flush(self, now_s: float) -> None:
        """Sends what is due, as far as the socket takes it."""
        self._unsent += b"".join(self.outbound.due(now_s))
        try:
            if self._unsent:
                self._unsent = self._unsent[self.socket.send(self._unsent) :]
        except BlockingIOError:
            pass
        except OSError:
            self.close()

    def cut(self) -> None:
        """Ends the connection with a reset."""
        try:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        except OSError:
            pass
        self.close()

    def close(self) -> None:
        self.closed = True
        self.socket.close()
