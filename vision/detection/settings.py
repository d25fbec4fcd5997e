"""Settings of mark detection: coverage, outline, rim, components and centres, with units and origins.

Lengths in sizes are relative to the half axes of a mark.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class CoverageSettings:
    """Settings for the share of each pixel that a mark covers.

    grow_px: distance over which lens, colour mosaic and compression spread a pixel [px]: the mark's edge may be this
    far outside the component, and noise is correlated up to this lag; choice
    pad_px: width of the border around the component, whose outer part shows the background [px]; choice
    core_px: distance inside the component from which pixels show only the mark, even with highlights [px]; choice
    outlier_sds: distance from the background's median above which pixels are not background [standard deviations];
        source: normal distribution, two-sided 99.99 %
    edge_gain: noise variance / variance of half the difference of two pixels [1]; choice: white noise has 2
    floor_sd_px: least standard deviation of a centre, due to rounding and shading [px]; choice
    """

    grow_px: int = 3
    pad_px: int = 8
    core_px: int = 2
    outlier_sds: float = 3.890591886413
    edge_gain: float = 1.6
    floor_sd_px: float = 0.0025

    def for_kernel(self) -> tuple[float, ...]:
        """The settings in the form of `kernels.covered`."""
        return self.outlier_sds, self.grow_px, self.core_px, self.edge_gain, self.floor_sd_px**2


@dataclass(frozen=True, slots=True)
class OutlineSettings:
    """Settings for the fit of an outline to the edge of a mark.

    reach: largest distance of an edge from the middle of the visible part [sizes]; choice
    near_px: largest distance of an edge from a circle on which it lies [px]; choice
    correlation_px: width over which errors of an edge are correlated [px]; choice
    highest_wave: highest order of the waves around the outline, from order 2 on, that measure noise [1]; choice
    edge_sd_px: least standard deviation of an edge [px]; choice
    min_share: least share of directions with the mark's own edge, and least visible share of its area [1]; choice
    whole_share: a mark is partly occluded if its share of directions with an edge, or of its area, is smaller [1]; a
        piece larger than the mark's area divided by this share may be several touching marks; choice
    """

    reach: float = 2.0
    near_px: float = 0.4
    correlation_px: float = 3.0
    highest_wave: int = 7
    edge_sd_px: float = 0.05
    min_share: float = 0.2
    whole_share: float = 0.9

    def for_kernel(self) -> tuple[float, ...]:
        """The settings in the form of `kernels.fitted`."""
        return (
            self.near_px,
            self.correlation_px,
            self.highest_wave,
            self.edge_sd_px,
            self.min_share,
            self.whole_share,
            self.reach,
        )


@dataclass(frozen=True, slots=True)
class RimSettings:
    """Settings for the fit of a mark's rim to steps of colour.

    around: distance inside and outside the outline over which steps are searched along a ray [sizes]; choice
    blur_px: standard deviation of the smoothing before the search [px]; choice
    min_step: least step over two pixels, summed over the colour channels [grey levels]; choice
    wide, narrow_px: largest distance of a step from the circle, in the first [sizes] and last iteration [px]; choice
    min_share: share of all directions, weighted by contrast, below which part of the mark is occluded [1]; choice
    min_share_alone: least share of directions, weighted by contrast, if only the rim shows the mark [1]; choice
    smear_gain: variance of the rim's centre relative to the spread that motion adds to the mark [1]; choice
    shading: shift that shading causes for the rim of a fully visible ball [sizes]; choice
    """

    around: float = 0.45
    blur_px: float = 1.5
    min_step: float = 5.0
    wide: float = 0.3
    narrow_px: float = 1.0
    min_share: float = 0.3
    min_share_alone: float = 0.45
    smear_gain: float = 0.12
    shading: float = 0.01


@dataclass(frozen=True, slots=True)
class ComponentSettings:
    """Settings of connected pixels that may be a mark.

    max_picture_share: share of the picture above which a hue shows the scene, not marks [1]; choice
    max_elongation: largest ratio of longest to shortest axis [1]; choice
    max_noise: largest noise of a mark's pixels relative to its contrast; a stain such as blood has more [1]; choice
    """

    max_picture_share: float = 0.3
    max_elongation: float = 4.0
    max_noise: float = 0.2


@dataclass(frozen=True, slots=True)
class CenterSettings:
    """Settings for the choice among several centres of a mark.

    gate: squared Mahalanobis distance above which two centres differ and no rim is searched [1];
        source: chi-square, 2 dof, 99.9 %
    agree_sd_px: additional standard deviation of the difference of two centres of one mark [px]; choice
    min_area: least area of a component relative to the mark's area or, before its edge is measured, to the least area
        in its colour class [1]; the inverse is the largest relative area; choice
    grain_noise, grain_gain: noise relative to contrast above which errors of an outline are correlated, and the largest
        resulting increase of their variance [1]; choice
    blurred: spread of a mark at rest in a picture, relative to that of its outline [1]; choice
    """

    gate: float = 13.815510557964274
    agree_sd_px: float = 0.08
    min_area: float = 0.5
    grain_noise: float = 0.02
    grain_gain: float = 3.2
    blurred: float = 1.2

    @property
    def max_area(self) -> float:
        """Largest area that may be one mark, relative to the mark's area."""
        return 1.0 / self.min_area

    def for_kernel(self) -> tuple[float, ...]:
        """The settings in the form of `kernels.agreed`."""
        return self.min_area, self.max_area, self.agree_sd_px**2, self.gate


@dataclass(frozen=True, slots=True)
class DetectionSettings:
    """Settings of `detect_marks`, one record for each stage."""

    coverage: CoverageSettings = field(default_factory=CoverageSettings)
    outline: OutlineSettings = field(default_factory=OutlineSettings)
    rim: RimSettings = field(default_factory=RimSettings)
    components: ComponentSettings = field(default_factory=ComponentSettings)
    centers: CenterSettings = field(default_factory=CenterSettings)


@dataclass(frozen=True, slots=True)
class HueLearningSettings:
    """Settings for learning a kind of mark from one position in a picture.

    window_px: half width of the first window around the position [px]; choice
    min_pixels: least number of pixels of one colour [1]; choice
    max_distance: largest difference of colours of one mark, relative to their distance from grey [1]; choice
    sds: half width of a range of hues, in standard deviations of the pixels' hues [1]; choice
    min_width_deg: least half width of a learned range, and limit for the standard deviation of its hues [degrees];
        choice
    paler, darker: factors for the least saturation and value of other marks [1]; choice
    """

    window_px: int = 8
    min_pixels: int = 12
    max_distance: float = 0.6
    sds: float = 3.0
    min_width_deg: float = 8.0
    paler: float = 0.6
    darker: float = 0.3


DETECTION = DetectionSettings()
"""Default settings of mark detection."""
HUE_LEARNING = HueLearningSettings()
"""Default settings of hue learning."""
