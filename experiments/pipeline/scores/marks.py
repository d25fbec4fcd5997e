"""Statistics of each mark in a run: how often it was found, rejected by the gate or not found, and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from experiments.formats.scene.marks import Mark
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import Step
from vision import LostMark, Reason

MANY = 0.05
"""A mark is reported if it was not used in more than this share of frames [1]; choice: 5 % lie outside 95 % regions."""

REFUSED = "refused by the gate"
NO_ROW = "no row in marks.csv"

LOOK_AT: Mapping[str, str] = {
    Reason.FEW_PIXELS: "softaim hue",
    Reason.SMALL: "diameter_mm, size_px and the distance of the camera",
    Reason.SIZE: "diameter_mm and the scale of the camera",
    Reason.SHAPE: "motion blur, and even = false for a ball",
    Reason.CONTRAST: "the background",
    Reason.STAIN: "light and noise, and even = false for a ball",
    Reason.COLOUR: "softaim hue, and lamps that change",
    Reason.UNLIKE: "what covers it",
    Reason.AMBIGUOUS: "marks of one hue that touch",
    Reason.TAKEN: "marks of one hue that cover each other",
    Reason.FAR: "the model, and the scale of the camera",
    Reason.OUTSIDE: "where the camera looks, and its scale",
    Reason.AWAY: "where the cameras stand",
    Reason.APART: "the calibration of the cameras, and their times",
    Reason.FLOODED: "softaim hue",
    REFUSED: "the model: softaim identify, softaim tune",
    NO_ROW: "the other tracker",
}
"""What the user should check, by the reason why a mark was lost."""

MISREAD = "units and axes of marks.csv: the first marks would fit as the verdict says"


@dataclass(frozen=True, slots=True)
class MarkShares:
    """Shares of frames in which a mark was found and used, found but rejected by the gate, and not found.

    reason: the most frequent reason why the mark was not used; reason_share: share of frames with this reason
    """

    measured: bool
    found: float
    refused: float
    lost: float
    reason: str | None
    reason_share: float


class MarkTally:
    """Counts the frames in which each mark was not used, by reason."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.n_frames = 0
        self._counts: Counter[tuple[str, str]] = Counter()

    def take(self, step: Step) -> None:
        """Count one frame."""
        self.n_frames += 1
        seen = {mark.node for mark in step.marks}
        lost = {} if step.sight is None else step.sight.lost
        for mark in self.scene.marks:
            if mark.node in step.refused:
                self._counts[mark.node, REFUSED] += 1
            elif mark.node not in seen:
                why = lost.get(mark.node)
                self._counts[mark.node, NO_ROW if why is None else why.reason] += 1

    def shares(self) -> dict[str, MarkShares]:
        """For each mark, by node, its shares of frames, as in `MarkShares`; empty if there were no frames.

        A mark that the filter does not use may be hidden. Such a mark is omitted if marks.csv never has it. It is also
        omitted if the marks come from films in space, because it is not searched for there.
        """
        n = self.n_frames
        listed = [mark for mark in self.scene.marks if mark.measured or self._counts[mark.node, NO_ROW] < n]
        return {mark.node: self._shares(mark) for mark in listed} if n else {}

    def _shares(self, mark: Mark) -> MarkShares:
        own = {reason: n / self.n_frames for (node, reason), n in self._counts.items() if node == mark.node}
        refused = own.get(REFUSED, 0.0)
        lost = sum(own.values()) - refused
        worst = max(own, key=lambda reason: own[reason], default=None)
        share = 0.0 if worst is None else own[worst]
        return MarkShares(mark.measured, 1.0 - refused - lost, refused, lost, worst and str(worst), share)


def marks_verdict(scene: Scene, shares: Mapping[str, MarkShares], *, misread: bool = False) -> str | None:
    """Line on the mark that was missed most often: why, and what to check; None if no mark's share exceeds `MANY`.

    misread: whether the first marks would fit the scene with other axes or units
    """
    missed = {node: one.refused + one.lost for node, one in shares.items() if one.measured}
    worst = max(missed, key=lambda node: missed[node], default=None)
    if worst is None or missed[worst] <= MANY:
        return None
    one = shares[worst]
    what = "refused" if one.reason == REFUSED else "not found"
    reason = one.reason or ""
    others = [node for node, share in missed.items() if share > MANY and node != worst]
    more = f" (also missed: {', '.join(others)})" if others else ""
    where = f"{what} in {100.0 * one.reason_share:.0f} % of frames"
    look_at = MISREAD if misread and reason == REFUSED else LOOK_AT[reason]
    return f"mark {worst}{more}: {where}: {reason_words(scene, worst, reason)}: check {look_at}"


def reason_words(scene: Scene, node: str, reason: str) -> str:
    """Text of a reason, with the keys of the mark's hue if the reason concerns the hue."""
    mark = next(mark for mark in scene.marks if mark.node == node)
    return reason.replace("its hue", f"hue {mark.hue_deg:g} ± {mark.half_width_deg:g}")


def lost_words(scene: Scene, node: str, lost: LostMark | None) -> str:
    """Reason why a mark was not found, and numbers in parentheses; lost: None for a mark of another tracker."""
    if lost is None:
        return NO_ROW
    words = reason_words(scene, node, str(lost.reason))
    return f"{words} ({lost.detail})" if lost.detail else words
