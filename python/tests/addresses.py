"""Loopback addresses for doubles, none twice in a session."""

import itertools

addresses = (f"127.0.0.{n}" for n in itertools.count(40))
