"""Settings of mark detection.

Lengths with the unit [sizes] are multiples of the half axes of the mark's outline. A component is a group of connected
pixels that have the colour of a mark.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class CoverageSettings:
    """Settings for the measurement of alpha, the share of each pixel that a mark covers.

    grow_px: distance over which lens, colour mosaic and compression blur the picture [px]; choice. The mark's edge may
        be this far outside the component. Noise is correlated over this distance.
    pad_px: width of the examined border around the component [px]; choice. Its outer part shows background.
    core_px: distance from the component's edge to its core [px]; choice. The pixels of the core show only the mark.
    outlier_sds: largest distance of a background pixel's colour from the background's median [standard deviations];
        source: normal distribution, two-sided 99.99 %
    edge_gain: variance of alpha at the mark's edge, relative to the variance of d [1]; choice. d is half the difference
        of alpha between opposite pixels of the mark. For white noise, 2 would be right.
    floor_sd_px: least standard deviation of a centre, due to rounding and shading [px]; choice
    """

    grow_px: int = 3
    pad_px: int = 8
    core_px: int = 2
    outlier_sds: float = 3.890591886413
    edge_gain: float = 1.6
    floor_sd_px: float = 0.0025

    def for_kernel(self) -> tuple[float, ...]:
        """The settings as a tuple, as `kernels.covered` needs them."""
        return self.outlier_sds, self.grow_px, self.core_px, self.edge_gain, self.floor_sd_px**2


@dataclass(frozen=True, slots=True)
class OutlineSettings:
    """Settings for the fit of an outline to the edge of a mark.

    Edge points are searched on rays that begin in the middle of the visible part of the mark.
    reach: length of the rays [sizes]; choice
    near_px: largest distance from the fitted outline at which an edge point counts as on the outline [px]; choice
    correlation_px: length along the edge over which errors of edge points are correlated [px]; choice
    highest_wave: highest order of the Fourier coefficients that measure the noise of the residuals [1]; choice. The
        lowest order is 2.
    edge_sd_px: least standard deviation of an edge point [px]; choice
    min_share: least share of rays that have an edge point on the outline [1]; choice. It is also the least visible
        share of a mark's area.
    whole_share: least share of rays, and least share of the mark's area, for a mark that is not occluded [1]; choice. A
        component may be several touching marks if its area exceeds 1 / whole_share times the area of one mark.
    """

    reach: float = 2.0
    near_px: float = 0.4
    correlation_px: float = 3.0
    highest_wave: int = 7
    edge_sd_px: float = 0.05
    min_share: float = 0.2
    whole_share: float = 0.9

    def for_kernel(self) -> tuple[float, ...]:
        """The settings as a tuple, as `kernels.fitted` needs them."""
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
    """Settings for the fit of a mark's rim (its outline) to steps of colour.

    around: half width of the band along the outline in which steps are searched [sizes]; choice
    blur_px: standard deviation of the smoothing before the search [px]; choice
    min_step: least step over two pixels, summed over the colour channels [grey levels]; choice
    wide: largest distance of a step from the fitted outline in the first iteration [sizes]; choice
    narrow_px: largest distance of a step from the fitted outline in the last iteration [px]; choice
    min_share: least share of rays with a step on the outline, for a mark that is not occluded [1]; choice. A ray has a
        larger weight in this share if its step is larger.
    min_share_alone: least share of rays with a step on the outline, for a mark that is detected by its rim alone [1];
        choice
    smear_gain: increase of the centre's variance due to motion, relative to the increase of the second moment of the
        mark's pixels due to motion [1]; choice
    shading: added standard deviation of the centre of a completely visible shaded ball [sizes]; choice
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
    """Limits for components that may be marks.

    max_picture_share: largest share of the picture that a hue of marks may cover [1]; choice
    max_elongation: largest ratio of longest to shortest axis [1]; choice
    max_noise: largest noise around a mark, relative to the mark's contrast [1]; choice. A stain of blood has more
        noise.
    """

    max_picture_share: float = 0.3
    max_elongation: float = 4.0
    max_noise: float = 0.2


@dataclass(frozen=True, slots=True)
class CenterSettings:
    """Settings for the choice among several centres of a mark.

    gate: largest squared Mahalanobis distance between the centre of a mark's visible area and the centre of its outline
        [1]; source: chi-square, 2 dof, 99.9 %. If a mark is detected by its rim alone, the same gate limits the search
        around the mark's expected position.
    agree_sd_px: standard deviation that is added to the difference between two centres of a mark [px]; choice
    min_area: least area of a component, relative to the mark's area [1]; choice. The upper limit is 1 / min_area.
    grain_noise: noise, relative to contrast, above which errors along an outline are correlated [1]; choice
    grain_gain: largest relative increase of the covariance of an outline's centre due to correlated errors [1]; choice
    blurred: factor by which blur increases the second moment of the pixels of a mark at rest [1]; choice
    """

    gate: float = 13.815510557964274
    agree_sd_px: float = 0.08
    min_area: float = 0.5
    grain_noise: float = 0.02
    grain_gain: float = 3.2
    blurred: float = 1.2

    @property
    def max_area(self) -> float:
        """Largest area of a component that is one mark, relative to the mark's area."""
        return 1.0 / self.min_area

    def for_kernel(self) -> tuple[float, ...]:
        """The limits as a tuple, as `kernels.agreed` needs them."""
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
    """Settings for learning the colour range of a kind of mark from one position in a picture.

    window_px: half width of the first window around the position [px]; choice. The window grows for larger marks.
    min_pixels: least number of pixels of one colour [1]; choice
    max_distance: largest distance of a pixel's colour from the colour at the position, relative to the distance between
        grey and the colour at the position [1]; choice
    sds: half width of a learned range, in standard deviations of the pixels' hues [1]; choice
    min_width_deg: least half width of a learned range [degrees]; choice. The largest half width is sds * min_width_deg.
    paler: least saturation of marks, relative to the 5th percentile of the learned pixels' saturation [1]; choice
    darker: least value of marks, relative to the 5th percentile of the learned pixels' value [1]; choice
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
