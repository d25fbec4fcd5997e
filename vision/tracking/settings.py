"""Settings of the mark finder: association, appearance, templates, candidates and colours that drift."""

from __future__ import annotations

from dataclasses import dataclass, field

from vision.detection.settings import DetectionSettings

GATE = 18.420680743952367
"""Squared Mahalanobis distance that one true mark in 10,000 exceeds: chi-square, 2 degrees of freedom, 99.99 %."""
REACH_SDS = GATE**0.5
"""How far from its expected place a mark is searched for: as far as that."""


@dataclass(frozen=True, slots=True)
class AssociationSettings:
    """Which detection is which mark.

    gate: squared Mahalanobis distance that one true mark in 10,000 exceeds [1]; source: chi-square, 2 dof, 99.99 %
    impulse_gate: the same for one of many candidates after an impulse [1]; source: chi-square, 2 dof, 99 %
    ambiguity: touching marks need this much more squared distance if their names are exchanged [1]; choice
    """

    gate: float = GATE
    impulse_gate: float = 9.21
    ambiguity: float = 16.0


@dataclass(frozen=True, slots=True)
class AppearanceSettings:
    """How a picture is compared, pixel by pixel, with a mark as it was seen whole.

    n_views: views of a mark of which its appearance is the median [1]; choice
    inner, outer: up to where a pixel is all mark, and from where on it is background [sizes]; choice
    ring_px: width of the ring around a mark [px]; choice
    blur_px: standard deviation of the smoothing before [px]; choice
    match: mean square over the colours up to which two pixels are alike [variances]; choice
    shade: error of a colour by shadow and lamps, by its level [1]; choice
    min_sd, unknown_sd: standard deviation of a pixel at least, and where too few views show it [grey levels]; choice
    grain: standard deviation of a pixel by the median absolute deviation of the views [1]; choice
    ring_contrast: how much nearer colours of the ring must be to a fitted colour to be alike [1]; choice
    occluded_cost: cost of a pixel that is neither like the mark nor like its background [1]; choice
    ring_weight: weight of the ring by that of the inside [1]; choice
    prior, free_prior: loss of score by squared Mahalanobis distance, and where the colour is fitted [1]; choice
    max_reach_px: marks that may be further away are not searched for by their appearance [px]; choice
    n_fits: how often the colour of a mark in other light is fitted [1]; choice
    coarse_px: distance of the places that are searched first [px]; choice
    darkest, brightest: how far light may have changed [1]; choice
    max_blend: likeness of mark and background, -1 to 1, from which on they are not told apart [1]; choice
    """

    n_views: int = 5
    inner: float = 0.85
    outer: float = 1.12
    ring_px: float = 2.5
    blur_px: float = 0.8
    match: float = 9.0
    shade: float = 0.08
    min_sd: float = 4.0
    unknown_sd: float = 8.0
    grain: float = 2.2
    ring_contrast: float = 2.0
    occluded_cost: float = 0.2
    ring_weight: float = 0.5
    prior: float = 0.02
    free_prior: float = 0.05
    max_reach_px: float = 25.0
    n_fits: int = 4
    coarse_px: int = 3
    darkest: float = 0.3
    brightest: float = 2.0
    max_blend: float = 0.5

    def for_kernel(self) -> tuple[float, ...]:
        """As the kernels of `appearance` take them."""
        light = self.darkest, self.brightest
        return self.match, self.shade, self.ring_contrast, self.occluded_cost, float(self.n_fits), *light


@dataclass(frozen=True, slots=True)
class CandidateSettings:
    """When a place that looks like a mark is one, and how well its centre is known.

    score, share: least score, and least share of its pixels that look like the mark [1]; choice
    free, free_share, free_score: likeness of the ring below which the place is free, and what is enough there; choice
    doubtful, doubtful_score: likeness of the ring above which a missing mark needs this score [1]; choice
    sure_score: score from which on a place is the mark whatever its colour [1]; choice
    even_share, even_around, even_score, even_sure_score: the same in other light; choice
    max_off: how far the colour may then be off, squared [gates]; choice
    apart, apart_share, apart_score, apart_sure_score: the same where nothing around looks like it; choice
    min_sd_px, max_sd_px: standard deviation of a place [px]; choice
    known_score, known_growth: score up to which it is the least, and its growth below; choice
    rim_score, rim_growth, other_score, other_growth: the same in other light, with a rim and without; choice
    max_rim_px: how far from a place its rim may be [px]; choice
    rim_off: standard deviation by the distance of place and rim [1]; choice
    shared: variance of the mean of outline and place by that of independent ones [1]; choice
    """

    score: float = 0.55
    share: float = 0.7
    free: float = -0.9
    free_share: float = 0.3
    free_score: float = 0.4
    doubtful: float = 0.3
    doubtful_score: float = 0.75
    sure_score: float = 0.7
    even_share: float = 0.8
    even_around: float = -0.2
    even_score: float = 0.75
    even_sure_score: float = 1.0
    max_off: float = 2.0
    apart: float = -0.95
    apart_share: float = 0.4
    apart_score: float = 0.65
    apart_sure_score: float = 0.85
    min_sd_px: float = 0.27
    max_sd_px: float = 1.2
    known_score: float = 1.35
    known_growth: float = 2.6
    rim_score: float = 1.25
    rim_growth: float = 2.5
    other_score: float = 1.4
    other_growth: float = 4.0
    max_rim_px: float = 3.0
    rim_off: float = 0.35
    shared: float = 1.6


@dataclass(frozen=True, slots=True)
class TemplateSettings:
    """When what was found is compared with appearance models, and when it is kept.

    clear_sd_px: standard deviation below which a whole mark is one beyond doubt [px]; choice
    whole_sd_px: the same up to which it is remembered [px]; choice
    unknown_sd_px: the same up to which it is kept where nothing can be compared [px]; choice
    worthless_sd_px: the same above which a centre is of no use [px]; choice
    refresh: frames after which a view is taken again [1]; choice
    forget: frames after which a mark that was not seen clearly may look different [1]; choice
    near_px: distance up to which a centre and the best place agree [px]; choice
    as_good: what was found may have so much less of a score than the best place [1]; choice
    plain_score: score from which on nothing further away is searched [1]; choice
    near_score, merged: least score, and most likeness of the ring, of what was found [1]; choice
    """

    clear_sd_px: float = 0.15
    whole_sd_px: float = 0.5
    unknown_sd_px: float = 0.6**0.5
    worthless_sd_px: float = 3.0
    refresh: int = 2
    forget: int = 150
    near_px: float = 3.0
    as_good: float = 0.1
    plain_score: float = 1.1
    near_score: float = 0.45
    merged: float = 0.65


@dataclass(frozen=True, slots=True)
class HueTrackingSettings:
    """How the colour of a kind of mark is followed.

    gain: share of the newest frame in the mean colour [1]; choice
    max_drift: how far the hue may drift [half widths]; choice
    paler, darker: least saturation and value that count, by the mean [1]; choice
    min_saturation, min_value: below these no drift is followed [1]; choice
    hue_sd_deg, saturation_sd: least scatter of hue [degrees] and saturation [1]; choice
    max_scatter: largest scatter by the least [1]; choice
    n_learned: frames after which a colour gates [1]; choice
    gate: squared distance in these scatters [1]; source: chi-square, 2 dof, 99.9 %
    """

    gain: float = 0.05
    max_drift: float = 1.5
    paler: float = 0.6
    darker: float = 0.3
    min_saturation: float = 0.12
    min_value: float = 0.05
    hue_sd_deg: float = 6.0
    saturation_sd: float = 0.07
    max_scatter: float = 2.0
    n_learned: int = 3
    gate: float = 13.815510557964274


@dataclass(frozen=True, slots=True)
class FinderSettings:
    """Settings of `MarkFinder`, a record for each part of it.

    min_area, max_area: share of its area that a mark without an outline shows at least, and any at most [1]; choice
    min_seen: share of its area that a mark with an outline shows at least [1]; choice
    min_radius_px: radius from which on a mark has an outline and an appearance [px]; choice
    max_regions: share of the picture up to which regions are searched rather than all of it [1]; choice
    """

    min_area: float = 0.5
    max_area: float = 2.0
    min_seen: float = 0.15
    min_radius_px: float = 3.5
    max_regions: float = 0.2
    detection: DetectionSettings = field(default_factory=DetectionSettings)
    association: AssociationSettings = field(default_factory=AssociationSettings)
    appearance: AppearanceSettings = field(default_factory=AppearanceSettings)
    candidates: CandidateSettings = field(default_factory=CandidateSettings)
    templates: TemplateSettings = field(default_factory=TemplateSettings)
    hue: HueTrackingSettings = field(default_factory=HueTrackingSettings)


FINDER = FinderSettings()
"""The defaults."""
