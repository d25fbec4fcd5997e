"""Settings of the mark finder and of its parts."""

from __future__ import annotations

from dataclasses import dataclass, field

from vision.detection.settings import DetectionSettings, HueLearningSettings

GATE = 18.420680743952367
"""Squared Mahalanobis distance that one correct detection in 10,000 exceeds: chi-square, 2 dof, 99.99 %."""
REACH_SDS = GATE**0.5
"""Mahalanobis distance from the expected position within which a mark is searched [1]."""

STAGE_NAMES = (
    "isolated",
    "regions",
    "picture",
    "impulse",
    "check",
    "appearance",
    "other light",
    "rim",
    "ambiguity",
)
"""Names of the stages in `vision.tracking.stages`, in their order."""


@dataclass(frozen=True, slots=True)
class AssociationSettings:
    """Settings of the association of detections with marks.

    gate: largest squared Mahalanobis distance of a detection from its mark's expected position [1]; source: chi-square,
        2 dof, 99.99 %. Two touching marks are rejected if an exchange of their names increases the sum of their squared
        distances by less than gate.
    impulse_gate: smaller gate for marks that an impulse may have moved [1]; source: chi-square, 2 dof, 99 %. It applies
        if more detections are unassigned than marks are missing.
    """

    gate: float = GATE
    impulse_gate: float = 9.21


@dataclass(frozen=True, slots=True)
class AppearanceSettings:
    """Settings for the comparison of a picture, pixel by pixel, with a mark's appearance.

    n_views: number of stored views of a mark; their median is the mark's appearance [1]; choice
    margin: distance from the outline within which pixels are ignored, relative to the mark's half axes [1]; choice
    ring_px: width of the ring of background pixels around a mark [px]; choice
    blur_px: standard deviation of the smoothing before the comparison [px]; choice
    shade: largest rms difference, over the colour channels, between similar pixels due to light, relative to the colour
        [1]; choice
    level: largest rms difference, over the colour channels, between similar pixels due to noise [grey levels]; choice
    ring_contrast: factor on the squared distance between a ring pixel's colour and a fitted colour [1]; choice
    occluded_cost: loss of score for a pixel in the mark that resembles neither the mark nor its background [1]; choice.
        The loss for a pixel that resembles the background is 1.
    ring_weight: loss of score per unit of similarity between ring and mark [1]; choice
    prior: loss of score per squared Mahalanobis distance from the expected position [1]; choice
    other_prior: value that replaces prior if the mark's colour is fitted [1]; choice
    max_reach_px: largest half width of the search around the expected position [px]; choice. If the expected position
        is too uncertain for this width, the mark's appearance is not searched.
    """

    n_views: int = 5
    margin: float = 0.14
    ring_px: float = 2.5
    blur_px: float = 0.8
    shade: float = 0.24
    level: float = 15.0
    ring_contrast: float = 2.0
    occluded_cost: float = 0.2
    ring_weight: float = 0.5
    prior: float = 0.02
    other_prior: float = 0.05
    max_reach_px: float = 25.0

    def for_kernel(self) -> tuple[float, ...]:
        """The settings in the form that the kernels of `likeness` need."""
        return self.shade, self.level, self.ring_contrast, self.occluded_cost


@dataclass(frozen=True, slots=True)
class CandidateSettings:
    """Settings for matches: limits of similarity, and accuracy of the centre.

    A match is the position at which the picture is most similar to a mark's appearance. The ring consists of the pixels
    around the mark, which usually show background.
    score: least score of a match [1]; choice
    share: least share of similar pixels in the mark [1]; choice
    free: similarity between ring and mark below which the ring is certainly background [1]; choice
    free_share: least share of similar pixels in the mark if the ring is certainly background [1]; choice
    other_margin: increase of the least score if the mark's colour is fitted [1]; choice. If the colour is fitted, the
        similarity between ring and mark must also be at most -other_margin.
    min_sd_px, max_sd_px: least and largest standard deviation of a match's centre [px]; choice
    best_score: least score at which the standard deviation of the centre is min_sd_px [1]; choice
    growth: factor g in the centre's standard deviation, `min_sd_px * exp(g * (best_score - score))` [1]; choice
    rim_gain: standard deviation that is added if a match's centre is averaged with a rim's centre, relative to the
        distance between these centres [1]; choice
    shared: factor on the covariance of the weighted mean of a detection and a match [1]; choice. The factor allows for
        correlated errors of the detection and the match.
    """

    score: float = 0.55
    share: float = 0.7
    free: float = -0.9
    free_share: float = 0.3
    other_margin: float = 0.2
    min_sd_px: float = 0.27
    max_sd_px: float = 1.2
    best_score: float = 1.35
    growth: float = 2.6
    rim_gain: float = 0.35
    shared: float = 1.6


@dataclass(frozen=True, slots=True)
class TemplateSettings:
    """Settings of appearance models: when detections are compared with them, and when views are stored.

    clear_sd_px: largest standard deviation of the centre at which a detection needs no comparison [px]; choice
    whole_sd_px: largest standard deviation of the centre at which a detection's view is stored [px]; choice
    unknown_sd_px: largest standard deviation of the centre at which a detection needs no match [px]; choice
    refresh: number of frames after which a new view replaces the oldest view [1]; choice
    forget: number of frames without a new view after which a model is deleted [1]; choice
    near_px: up to this distance between their centres, a detection and a match agree [px]; choice
    plain_score: least score at which a match near a detection is accepted without a search elsewhere [1]; choice
    """

    clear_sd_px: float = 0.15
    whole_sd_px: float = 0.5
    unknown_sd_px: float = 0.77
    refresh: int = 2
    forget: int = 150
    near_px: float = 3.0
    plain_score: float = 1.1


@dataclass(frozen=True, slots=True)
class HueTrackingSettings:
    """Settings for the adaptation of the colour of a kind of mark.

    gain: weight of the newest frame in the running mean of the colour [1]; choice
    max_drift: largest drift of the hue since the start, relative to the half width of the colour range [1]; choice
    hue_sd_deg: least standard deviation of the hue of marks of one kind [degrees]; choice
    saturation_sd: least standard deviation of the saturation of marks of one kind [1]; choice
    max_scatter: factor from hue_sd_deg and saturation_sd to the largest learned standard deviations [1]; choice
    n_learned: number of frames with the mark before detections of another colour are rejected [1]; choice
    gate: largest squared Mahalanobis distance of hue and saturation [1]; source: chi-square, 2 dof, 99.9 %
    learning: settings of the first colour range; `paler` and `darker` also apply to the adapted colour range
    """

    gain: float = 0.05
    max_drift: float = 1.5
    hue_sd_deg: float = 6.0
    saturation_sd: float = 0.07
    max_scatter: float = 2.0
    n_learned: int = 3
    gate: float = 13.815510557964274
    learning: HueLearningSettings = field(default_factory=HueLearningSettings)


@dataclass(frozen=True, slots=True)
class DistractorSettings:
    """Settings for reports of distractors in a mark's colour. The limits least, grows and wavers apply together.

    spacing: distance between sampled pixels, relative to the radius of the smallest mark [1]; choice
    most_samples: largest number of sampled pixels in a frame [1]; choice: sampling takes 0.1 ms
    around: distance from a mark's centre within which pixels are ignored, relative to the mark's radius [1]; choice
    stands: number of successive frames that must show a new object before its report [1]; source: requirement to report
        a fault within three frames
    settled_frames: number of frames at the start [1]; choice. Objects in these frames are known, not new.
    least: least reported area of new objects of one hue, relative to the area of a mark [1]; choice
    grows: least reported area of new objects, relative to their area in the last report [1]; choice
    wavers: least reported area of new objects, relative to the area of known objects [1]; choice
    """

    spacing: float = 0.5
    most_samples: int = 20_000
    around: float = 1.5
    stands: int = 3
    settled_frames: int = 30
    least: float = 0.5
    grows: float = 2.0
    wavers: float = 0.25


@dataclass(frozen=True, slots=True)
class FinderSettings:
    """Settings of `MarkFinder`. Each part of the finder has a settings record of its own.

    min_radius_px: least radius of a mark for which outline and appearance are used [px]; choice
    stages: names of the stages that run, in this order; source: the list in `vision.tracking.stages`
    """

    min_radius_px: float = 3.5
    stages: tuple[str, ...] = STAGE_NAMES
    detection: DetectionSettings = field(default_factory=DetectionSettings)
    association: AssociationSettings = field(default_factory=AssociationSettings)
    appearance: AppearanceSettings = field(default_factory=AppearanceSettings)
    candidates: CandidateSettings = field(default_factory=CandidateSettings)
    templates: TemplateSettings = field(default_factory=TemplateSettings)
    hue: HueTrackingSettings = field(default_factory=HueTrackingSettings)
    distractors: DistractorSettings = field(default_factory=DistractorSettings)


FINDER = FinderSettings()
"""Default settings of the mark finder."""
