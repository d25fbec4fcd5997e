"""Settings of the mark finder: association, appearance, templates, candidates, drifting colours, distractors."""

from __future__ import annotations

from dataclasses import dataclass, field

from vision.detection.settings import DetectionSettings, HueLearningSettings

GATE = 18.420680743952367
"""Squared Mahalanobis distance that one true mark in 10,000 exceeds: chi-square, 2 degrees of freedom, 99.99 %."""
REACH_SDS = GATE**0.5
"""Mahalanobis distance within which a mark is searched [1]."""

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

    gate: squared Mahalanobis distance that one true mark in 10,000 exceeds, and least increase of this distance if the
        names of touching marks are exchanged [1]; source: chi-square, 2 dof, 99.99 %
    impulse_gate: gate for one of many candidates after an impulse [1]; source: chi-square, 2 dof, 99 %
    """

    gate: float = GATE
    impulse_gate: float = 9.21


@dataclass(frozen=True, slots=True)
class AppearanceSettings:
    """Settings for the comparison of a picture, pixel by pixel, with a mark's appearance.

    n_views: number of views of a mark whose median is its appearance [1]; choice
    margin: distance from the outline within which pixels are neither mark nor background [sizes]; choice
    ring_px: width of the ring around a mark [px]; choice
    blur_px: standard deviation of the smoothing before the comparison [px]; choice
    shade: rms difference of similar pixels due to shadow and lamps, relative to their level [1]; choice
    level: rms difference of similar pixels over the colours, due to noise [grey levels]; choice
    ring_contrast: factor by which a colour of the ring must be nearer to a fitted colour to be similar [1]; choice
    occluded_cost: cost of a pixel that is neither similar to the mark nor to its background [1]; choice
    ring_weight: weight of the ring relative to that of the inside [1]; choice
    prior, other_prior: loss of score per squared Mahalanobis distance from the expected position, for a known and for a
    fitted colour [1]; choice
    max_reach_px: search range above which a mark is not searched by its appearance [px]; choice
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
    """Settings of detections by appearance: acceptance of a match, and accuracy of its centre.

    score, share: least score of a match, and least share of the mark's pixels that are similar [1]; choice
    free, free_share: similarity below which the ring is unlike the mark, and least share in this case [1]; choice
    other_margin: additional similarity to the mark and dissimilarity of the ring that a fitted colour needs [1]; choice
    min_sd_px, max_sd_px: least and largest standard deviation of a match [px]; choice
    best_score, growth: score above which this deviation is min_sd_px, and its exponential growth below that [1]; choice
    rim_gain: standard deviation of the mean of match and rim, relative to their distance [1]; choice
    shared: variance of the mean of outline and match, relative to the mean of independent errors [1]; choice
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

    clear_sd_px: largest standard deviation of a centre with which a whole mark is certain [px]; choice
    whole_sd_px: largest standard deviation of a centre with which the mark's view is stored [px]; choice
    unknown_sd_px: largest standard deviation with which a mark is accepted without a comparison [px]; choice
    refresh: number of frames after which a view is stored again [1]; choice
    forget: number of frames without a clear view after which a mark may look different [1]; choice
    near_px: largest distance at which a centre and the best match agree [px]; choice
    plain_score: score above which the search stops [1]; choice
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

    gain: share of the newest frame in the mean colour [1]; choice
    max_drift: largest drift of the hue [half widths]; choice
    hue_sd_deg, saturation_sd: least standard deviations of colours of one kind: hue [degrees], saturation [1]; choice
    max_scatter: largest standard deviation of colours, relative to these least ones [1]; choice
    n_learned: number of frames after which a learned colour rejects other colours [1]; choice
    gate: largest squared distance in these standard deviations [1]; source: chi-square, 2 dof, 99.9 %
    learning: settings of the first colour range; `paler` and `darker` also relate later limits to the mean colour
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
    """Settings for reports of distractors in a mark's colour.

    spacing: distance of the samples [radii of the smallest mark]; choice
    most_samples: largest number of samples in a frame [1]; choice: sampling takes 0.1 ms
    around: distance from a mark within which samples belong to it, due to blur or its reflection [radii]; choice
    stands: number of successive frames that must show an object [1]; source: report a fault within three frames
    settled_frames: number of first frames, whose content counts as known [1]; choice
    least: least new area, relative to that of a mark [1]; choice
    grows: least ratio of the present area to that in the last report [1]; choice
    wavers: least ratio of the new area to the known area [1]; choice
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
    """Settings of `MarkFinder`, with a record for each of its parts.

    min_radius_px: least radius of a mark with an outline and an appearance [px]; choice
    stages: the stages that run, in their order; source: the list in `vision.tracking.stages`
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
