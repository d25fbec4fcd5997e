"""Finder of a scene's marks. It searches near expected positions, names detections, and adapts to marks' colours."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields

from vision.arrays import Image
from vision.detection.expected import Expected
from vision.detection.hue import MarkHue
from vision.detection.records import HueError
from vision.tracking.association import AssociatedMark
from vision.tracking.distractors import Distractor, DistractorWatch
from vision.tracking.hue_tracking import AdaptiveHue
from vision.tracking.reasons import LostMark, Rejections, lost_marks
from vision.tracking.settings import FINDER, FinderSettings
from vision.tracking.stages import Search, stages_named
from vision.tracking.templates import AppearanceTemplates


class MarkFinder:
    """Finds marks in successive frames by their hue, and names them by their expected positions.

    The finder searches near expected positions. In the first frame, and if a mark is missing, it searches the whole
    picture.
    hues: colour range of each kind of mark; settings: settings of all stages
    explain: whether to record in `lost` why marks are missing, and in `came` which distractors are new

    Raises HueError if two marks of one hue have different colour ranges. Raises ValueError for an unknown stage.
    """

    def __init__(
        self, hues: Iterable[MarkHue], settings: FinderSettings | None = None, *, explain: bool = False
    ) -> None:
        self.settings = settings = FINDER if settings is None else settings
        self.hues = {hue.hue_deg: AdaptiveHue(hue, settings.hue) for hue in _of_one_range(hues)}
        self.templates = AppearanceTemplates(settings)
        self.missed: set[str] | None = None
        self._stages = stages_named(settings.stages)
        self._explain = explain
        self._last: Search | None = None
        self._distractors = DistractorWatch(settings.distractors)
        self.came: tuple[Distractor, ...] = ()

    def find(
        self,
        frame_bgr: Image,
        expected: Sequence[Expected],
        expected_after_impulse: Callable[[str], Expected] | None = None,
    ) -> list[AssociatedMark]:
        """Find marks in a frame; returns the found marks in any order.

        frame_bgr: (height, width, 3) uint8
        expected: expected position of each mark
        expected_after_impulse: function from the name of a mark to its expected position after an impulse
        """
        search = Search(
            frame_bgr,
            expected,
            expected_after_impulse,
            self.hues,
            self.templates,
            self.missed,
            self.settings,
            Rejections() if self._explain else None,
        )
        for stage in self._stages:
            stage.run(search)
        self.templates.forget()
        self.missed = {one.name for one in search.missing}
        if self._explain:
            now = {nominal: followed.now for nominal, followed in self.hues.items()}
            self.came = self._distractors.update(frame_bgr, now, expected, search.found)
        for nominal, followed in self.hues.items():
            followed.follow([seen for seen in search.found.values() if seen.hue_deg == nominal])
        self._last = search if self._explain else None
        return [AssociatedMark(name, seen) for name, seen in search.found.items()]

    @property
    def lost(self) -> tuple[LostMark, ...]:
        """Marks that were not found in the last frame, with reasons; empty if the finder has explain = False."""
        search = self._last
        if search is None or search.rejections is None:
            return ()
        height, width = search.frame_bgr.shape[:2]
        return lost_marks(
            search.missing,
            search.found,
            search.unassigned,
            search.rejections,
            size_px=(width, height),
            settings=search.settings,
        )


def _of_one_range(hues: Iterable[MarkHue]) -> list[MarkHue]:
    """The colour ranges without duplicates; raises HueError if two marks of one hue have different colour ranges."""
    known: dict[float, MarkHue] = {}
    for hue in hues:
        other = known.setdefault(hue.hue_deg, hue)
        for key in (field.name for field in fields(MarkHue)):
            own, first = getattr(hue, key), getattr(other, key)
            if own != first:
                raise HueError(
                    f"marks of hue {hue.hue_deg:g} degrees: expected one {key} for all of them, found {first} and {own}"
                    "; give all the same, or hues that differ"
                )
    return list(known.values())
