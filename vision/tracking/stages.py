"""Stages of the mark finder. Each stage proposes candidates, and has a test that a candidate must pass.

A new stage needs a function that yields candidates, a function that tests one candidate, and an entry in STAGES.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from math import hypot, inf

import numpy as np

from vision.arrays import Image
from vision.detection.components import detect_marks
from vision.detection.expected import Expected
from vision.detection.fast_path import detect_isolated
from vision.detection.outline import Outline
from vision.detection.records import Detection, HueError, Reason
from vision.detection.rim_search import detect_by_rim
from vision.tracking.appearance import AppearanceMatch
from vision.tracking.association import associate_marks, squared_distance
from vision.tracking.candidates import detection_at, is_mark
from vision.tracking.hue_tracking import AdaptiveHue
from vision.tracking.reasons import Rejections
from vision.tracking.regions import Box, search_regions
from vision.tracking.settings import FinderSettings
from vision.tracking.templates import AppearanceTemplates

SMALL_SHARE = 0.2
"""Largest share of the picture that search regions cover [1]. Beyond it, a search of the whole picture is as fast."""


@dataclass(slots=True, eq=False)
class Search:
    """State of the search for the marks of one frame. Each stage reads and changes it.

    frame_bgr: (height, width, 3) uint8
    expected, expected_after_impulse: see `MarkFinder.find`
    hues: adapted colour range of each kind of mark, by nominal hue
    templates: appearance models
    missed: names of marks that were not found in the last frame; None if this frame is the first
    rejections: record of rejections; None: not recorded
    found: detections by the name of their mark; unassigned: detections that belong to no mark
    regions: search regions, see `search_regions`; where: the marks of `expected` by name
    """

    frame_bgr: Image
    expected: Sequence[Expected]
    expected_after_impulse: Callable[[str], Expected] | None
    hues: dict[float, AdaptiveHue]
    templates: AppearanceTemplates
    missed: set[str] | None
    settings: FinderSettings
    rejections: Rejections | None = None
    found: dict[str, Detection] = field(default_factory=dict)
    unassigned: list[Detection] = field(default_factory=list)
    regions: list[tuple[Box, list[Expected]]] = field(default_factory=list)
    where: dict[str, Expected] = field(init=False)

    def __post_init__(self) -> None:
        self.where = {one.name: one for one in self.expected}

    @property
    def missing(self) -> list[Expected]:
        """Expected marks that have not been found yet."""
        if len(self.found) == len(self.expected):
            return []
        return [one for one in self.expected if one.name not in self.found]

    def color_distance(self, seen: Detection) -> float:
        """Distance of a detection's colour from the colour of its kind of mark, see `AdaptiveHue.distance`."""
        return self.hues[seen.hue_deg].distance(seen)

    def is_apart(self, seen: Detection) -> bool:
        """Whether every found mark is farther than `CoverageSettings.pad_px` from this detection."""
        near = self.settings.detection.coverage.pad_px
        return all(np.hypot(*(seen.center_px - other.center_px)) > near for other in self.found.values())


@dataclass(slots=True, eq=False)
class Candidate:
    """A detection that may be a mark.

    detection: the detection; None: the earlier detection of the mark `name` is withdrawn
    name: name of the mark; None: the name is found by association
    match: match of the appearance model, if the detection was made from a match
    margin: increase of the sum of squared Mahalanobis distances if this mark and a touching mark exchange their names
    """

    detection: Detection | None
    name: str | None = None
    match: AppearanceMatch | None = None
    margin: float = inf


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """One stage of the finder.

    propose: function that yields candidates; accept: test of a candidate, True if it passes
    reason: recorded reason of a rejected candidate; None: nothing is recorded, because a later stage may find the mark
    """

    name: str
    propose: Callable[[Search], Iterable[Candidate]]
    accept: Callable[[Search, Candidate, Detection], bool]
    reason: Reason | None = None

    def run(self, search: Search) -> None:
        """Update `search.found`: add accepted candidates, and delete the names of rejected candidates."""
        unnamed: list[Detection] = []
        for candidate in self.propose(search):
            seen, name = candidate.detection, candidate.name
            if seen is None or not self.accept(search, candidate, seen):
                if search.rejections is not None:
                    search.rejections.note(self.reason, name, seen)
                if name is not None:
                    search.found.pop(name, None)
            elif name is None:
                unnamed.append(seen)
            else:
                search.found[name] = seen
        if unnamed:
            named = associate_marks(unnamed, search.missing, gate=search.settings.association.gate)
            search.found |= {one.name: one.detection for one in named}
            taken = [one.detection for one in named]
            search.unassigned = [seen for seen in unnamed if not any(seen is other for other in taken)]


def _isolated(search: Search) -> Iterator[Candidate]:
    """Detections of marks that are alone in their search region. There are none if the last frame lacked a mark."""
    if search.missed is None or search.missed:
        return
    shape = search.frame_bgr.shape[:2]
    regions = search_regions(search.expected, shape, search.settings)
    if sum(width * height for (_, _, width, height), _ in regions) >= SMALL_SHARE * shape[0] * shape[1]:
        return
    search.regions = regions
    hues = [followed.now for followed in search.hues.values()]
    single = [(box, own[0]) for box, own in regions if len(own) == 1]
    boxes, marks = [box for box, _ in single], [one for _, one in single]
    seen = detect_isolated(search.frame_bgr, hues, boxes, marks, search.settings.detection)
    yield from (Candidate(each, one.name) for each, one in zip(seen, marks, strict=True))


def _is_expected(search: Search, candidate: Candidate, seen: Detection) -> bool:
    """Whether a detection has the colour of its kind of mark, and is within the gate around the expected position."""
    near = candidate.name is not None and (
        squared_distance(search.where[candidate.name], seen) <= search.settings.association.gate
    )
    return near and search.color_distance(seen) <= 1.0


def _in_regions(search: Search) -> Iterator[Candidate]:
    """Detections in the search regions of marks that have not been found yet."""
    if len(search.found) == len(search.expected):
        return
    for box, own in search.regions:
        if any(one.name not in search.found for one in own):
            found = _components(search, own, box)
            yield from (one for one in found if one.detection and one.detection.hue_deg == own[0].hue_deg)


def _in_picture(search: Search) -> Iterator[Candidate]:
    """Detections in the whole picture, if a mark is missing. All earlier assignments in this frame are discarded.

    Raises HueError if a hue covers most of the picture in the first frame.
    """
    if len(search.found) == len(search.expected):
        return
    search.found.clear()
    search.unassigned = []
    if search.rejections is not None:
        search.rejections.begin_again()
    try:
        yield from _components(search, search.expected, None)
    except HueError as error:
        # after the first frame, an object in front of the camera is the cause
        if search.missed is None:
            raise
        if search.rejections is not None:
            search.rejections.flooded = error


def _components(search: Search, own: Sequence[Expected], region: Box | None) -> list[Candidate]:
    outlines, min_area_px, max_area_px = _sizes(own, search.settings)
    detections = detect_marks(
        search.frame_bgr,
        [followed.now for followed in search.hues.values()],
        min_area_px=min_area_px,
        max_area_px=max_area_px,
        region=region,
        outlines=outlines,
        expected_px=[one.center_px for one in own],
        expected_hues=[one.hue_deg for one in own],
        settings=search.settings.detection,
        rejected=None if search.rejections is None else search.rejections.pieces,
    )
    return [Candidate(seen) for seen in detections]


def _has_color(search: Search, _candidate: Candidate, seen: Detection) -> bool:
    """Whether a detection has the colour of its kind of mark."""
    return search.color_distance(seen) <= 1.0


def _after_impulse(search: Search) -> Iterator[Candidate]:
    """Unassigned detections near the positions at which missing marks are expected after an impulse."""
    missing, elsewhere = [one.name for one in search.missing], search.expected_after_impulse
    if elsewhere is None or not missing or not search.unassigned:
        return
    gates = search.settings.association
    gate = gates.gate
    if len(search.unassigned) > len(missing):
        # With more detections than missing marks, the gate is smaller, and only marks missed twice in a row are tried.
        gate = gates.impulse_gate
        missing = [name for name in missing if search.missed is not None and name in search.missed]
    for one in associate_marks(search.unassigned, [elsewhere(name) for name in missing], gate=gate):
        yield Candidate(one.detection, one.name)


def _checked(search: Search) -> Iterator[Candidate]:
    """Compare uncertain detections of found marks with the marks' appearance models, and store new views."""
    frame, templates = search.frame_bgr, search.templates
    where = search.where
    unclear = []
    for name, seen in search.found.items():
        if templates.is_clear(seen):
            templates.remember(frame, seen, where[name])
        elif templates.can_compare(where[name]):
            unclear.append((where[name], seen))
    for one, seen in unclear:
        better = templates.checked(frame, one, seen, search.color_distance)
        if better is not None and better.occluded == seen.occluded:
            # The view is stored with the centre before the comparison: otherwise the model would learn its own errors.
            templates.remember(frame, seen, one)
        yield Candidate(better, one.name)


def _is_like_it(_search: Search, _candidate: Candidate, _seen: Detection) -> bool:
    """True, because `_checked` has already tested the similarity."""
    return True


def _by_appearance(search: Search) -> Iterator[Candidate]:
    """Detections of missing marks at the best matches of their appearance models."""
    for one in search.missing:
        match = search.templates.match(search.frame_bgr, one) if search.templates.can_compare(one) else None
        if match is not None:
            yield Candidate(detection_at(match, one, search.settings.candidates), one.name, match)


def _is_match(search: Search, candidate: Candidate, seen: Detection) -> bool:
    """Whether a match is similar enough to its mark, and `Search.is_apart` is true for its detection."""
    match = candidate.match
    if match is None or not search.is_apart(seen):
        return False
    return is_mark(match, search.color_distance(seen), search.settings.candidates)


def _in_other_light(search: Search) -> Iterator[Candidate]:
    """Detections of missing marks with a fitted colour, from the appearance models of all marks of the same hue."""
    frame, templates = search.frame_bgr, search.templates
    for one in search.missing:
        match = templates.match_in_other_light(frame, one) if templates.can_compare(one) else None
        seen = None if match is None else templates.mark_in_other_light(frame, one, match, search.color_distance)
        if seen is not None:
            yield Candidate(seen, one.name, match)


def _is_apart(search: Search, _candidate: Candidate, seen: Detection) -> bool:
    """Whether `Search.is_apart` is true for a detection."""
    return search.is_apart(seen)


def _by_rim(search: Search) -> Iterator[Candidate]:
    """Detections by the rim, near the expected positions of missing marks without an appearance model."""
    for one in search.missing:
        if one.name not in search.templates:
            yield Candidate(detect_by_rim(search.frame_bgr, one, search.settings.detection))


def _has_color_apart(search: Search, _candidate: Candidate, seen: Detection) -> bool:
    """Whether a detection has the colour of its kind of mark, and `Search.is_apart` is true for it."""
    return search.color_distance(seen) <= 1.0 and search.is_apart(seen)


def _touching(search: Search) -> list[Candidate]:
    """Found marks that are expected to touch another mark of their hue."""
    where = search.where
    placed = [
        (name, seen, one.hue_deg, (one.outline.area_px / np.pi) ** 0.5, *one.center_px.tolist())
        for name, seen in search.found.items()
        if (one := where[name]).outline is not None
    ]
    margins: dict[str, float] = {}
    for (name, seen, hue, radius, u, v), (other_name, other_seen, other_hue, other_radius, x, y) in combinations(
        placed, 2
    ):
        if hue != other_hue or hypot(u - x, v - y) > radius + other_radius:
            continue
        one, other = where[name], where[other_name]
        named = squared_distance(one, seen) + squared_distance(other, other_seen)
        margin = squared_distance(one, other_seen) + squared_distance(other, seen) - named
        for each in (name, other_name):
            margins[each] = min(margin, margins.get(each, inf))
    return [Candidate(search.found[name], name, margin=margin) for name, margin in margins.items()]


def _is_unambiguous(search: Search, candidate: Candidate, _seen: Detection) -> bool:
    """Whether an exchange of names between touching marks is improbable."""
    return candidate.margin >= search.settings.association.gate


STAGES = (
    Stage("isolated", _isolated, _is_expected),
    Stage("regions", _in_regions, _has_color, Reason.COLOUR),
    Stage("picture", _in_picture, _has_color, Reason.COLOUR),
    Stage("impulse", _after_impulse, _has_color),
    Stage("check", _checked, _is_like_it, Reason.UNLIKE),
    Stage("appearance", _by_appearance, _is_match),
    Stage("other light", _in_other_light, _is_apart),
    Stage("rim", _by_rim, _has_color_apart),
    Stage("ambiguity", _touching, _is_unambiguous, Reason.AMBIGUOUS),
)
"""All stages, in their order."""


def stages_named(names: Sequence[str]) -> tuple[Stage, ...]:
    """The stages with these names, in the given order; raises ValueError for an unknown name."""
    known = {stage.name: stage for stage in STAGES}
    for name in names:
        if name not in known:
            raise ValueError(f"finder stages: expected some of {', '.join(known)}, found {name!r}")
    return tuple(known[name] for name in names)


def _sizes(marks: Sequence[Expected], settings: FinderSettings) -> tuple[list[Outline], float, float | None]:
    """Outlines of the marks, and limits of a component's area [px]. If a mark is too small, there are no outlines."""
    outlines = [one.outline for one in marks if one.outline is not None]
    if len(outlines) < len(marks) or not outlines:
        return [], 1.0, None
    limits, areas = settings.detection.centers, [one.area_px for one in outlines]
    if min(areas) < np.pi * settings.min_radius_px**2:
        return [], limits.min_area * min(areas), limits.max_area * max(areas)
    # area of all touching marks, if outlines can separate them
    most = len(marks) * limits.max_area * max(areas) if all(one.even for one in outlines) else None
    return outlines, settings.detection.outline.min_share * min(areas), most
