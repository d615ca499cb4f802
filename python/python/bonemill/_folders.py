"""Temporary folders, imported when first needed: the package itself comes up without them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tempfile import TemporaryDirectory


def temporary() -> TemporaryDirectory[str]:
    """A folder that is removed when nobody holds it any more."""
    import tempfile

    return tempfile.TemporaryDirectory(prefix="bonemill-")
