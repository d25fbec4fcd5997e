"""By how much the pictures of a live run may come later than their times say, and what that leaves of advice."""

from __future__ import annotations

UNEVEN = "pictures come too unevenly to tell when they were exposed"


class Lateness:
    """What a source knows of how late its pictures are.

    State: by how much they may be late [s], of which somebody looked at the picture; whether they come unevenly.
    """

    def __init__(self) -> None:
        self._late_s, self._known_s, self._uneven = 0.0, 0.0, False

    def take(self, late_s: float, *, uneven: bool) -> bool:
        """Take in what the source knows now; whether that is something else than before."""
        if (late_s, uneven) == (self._late_s, self._uneven):
            return False
        self._late_s, self._uneven = late_s, uneven
        self._known_s = min(self._known_s, late_s)
        return True

    def looked(self) -> None:
        """Somebody looked at the picture."""
        self._known_s = self._late_s

    @property
    def fault(self) -> str | None:
        """Why there is no advice, None where there may be."""
        if self._late_s > self._known_s:
            return f"pictures may come {self._late_s:.1f} s late since a pause: look at the picture, then reset"
        return UNEVEN if self._uneven else None
