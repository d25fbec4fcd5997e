"""How much of each pixel a mark covers, and with that its centre, its area and the covariance of the centre."""

import cv2
import numpy as np

GROW_PX, CORE_PX, FIT_PIXELS, GRAIN_REACH, LOCAL_REACH = 3, 2, 800, 7, 3
FLOOR_PX2, ROUNDING, OUTLIER_SDS, LOCAL_GAIN = 0.0025**2, 1.0 / 12.0, 3.890591886413, 1.6
"""As `vision.detection.coverage` has them, where each is explained."""


def cover(patch: np.ndarray, component: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """A mark's centre [px], (2,), from the patch's first pixel, the covariance of that [px²], (2, 2), its area [px].

    patch: (h, w, 3) BGR
    component: 1 on the pixels of the mark as the search found them, else 0, (h, w) uint8
    others: not 0 on pixels of other marks of the class, which are no background, (h, w) uint8
    """
    near = cv2.dilate(component, _ellipse(GROW_PX + max(component.shape) // 16))
    ring = np.equal(cv2.bitwise_or(near, others), 0).astype(np.uint8)
    plane, gram, noise_cov = _background(patch, ring)
    core = cv2.erode(component, _ellipse(CORE_PX), borderType=cv2.BORDER_REPLICATE)
    solid = core if cv2.countNonZero(core) >= 9 else component
    moments = cv2.moments(solid, binaryImage=True)
    middle = np.array([1.0, moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]])
    contrast = np.array(cv2.mean(patch, solid)[:3]) - middle @ plane
    # Best linear unbiased estimate of alpha where pixel = background + alpha contrast + noise, noise ~ (0, N):
    # alpha = d' N^-1 (pixel - background) / d' N^-1 d
    weights = np.linalg.solve(noise_cov, contrast)
    alpha = _unmixed(patch, plane, weights / (weights @ contrast))
    return _centered(alpha, near, core, ring, gram)


def _unmixed(patch: np.ndarray, plane: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(pixel - background) @ weights for every pixel, (h, w) float32."""
    constant, along_u, along_v = plane @ weights
    height, width = patch.shape[:2]
    projected = cv2.transform(patch.astype(np.float32), weights.astype(np.float32)[None, :])
    u, v = np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)[:, None]
    return projected - np.float32(along_u) * u - (np.float32(along_v) * v + np.float32(constant))


def _centered(alpha, near, core, ring, gram) -> tuple[np.ndarray, np.ndarray, float]:
    """Of pixels as 0 and 1, (h, w): all that the mark may reach, its core, what lies behind."""
    m = cv2.moments(np.where(core, np.float32(1.0), alpha * near))
    area = m["m00"]
    center = np.array([m["m10"], m["m01"]]) / area
    # d center / d alpha = (place - center) / area, for the pixels whose alpha was measured
    v, u = np.nonzero(near & (1 - core))
    places = np.column_stack([np.ones(len(u)), u, v])
    arms = (places[:, 1:] - center) / area
    behind = _power(alpha, ring.astype(np.float32), GRAIN_REACH)
    # Noise counts as much as its pixel moves the centre: compression leaves most of it at the mark's edge.
    leverage = np.zeros(alpha.shape, dtype=np.float32)
    leverage[v, u] = np.hypot(arms[:, 0], arms[:, 1])
    at_edge = max(behind, LOCAL_GAIN * _power(_lopsided(alpha, center), leverage, LOCAL_REACH))
    # What is wrong with the background's plane reaches the centre too; it comes from the noise where it was fitted.
    by_plane = arms.T @ places
    cov = at_edge * arms.T @ arms + behind * by_plane @ np.linalg.solve(gram, by_plane.T) + FLOOR_PX2 * np.eye(2)
    return center, cov, area


def _background(patch: np.ndarray, ring: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A plane of colour through the ring around a mark, color = [1, u, v] @ plane, and how colours stray about it.

    All (3, 3): plane, Gram matrix of its fit, covariance about it.
    """
    rows, columns = np.nonzero(ring)
    step = 1 + len(rows) // FIT_PIXELS
    rows, columns = rows[::step], columns[::step]
    colors = patch[rows, columns].astype(float)
    X = np.column_stack([np.ones(len(rows)), columns, rows])
    # Medians cost most of the time here; every fourth pixel tells them well enough.
    off = np.abs(colors - np.median(colors[::4], axis=0))
    # 1.4826 MAD is the standard deviation of a Gaussian; two grey levels allow for shading.
    kept = (off <= OUTLIER_SDS * (1.4826 * np.median(off[::4], axis=0) + 2.0)).all(axis=1)
    gram = X[kept].T @ X[kept]
    plane = np.linalg.solve(gram, X[kept].T @ colors[kept])
    # All pixels count here: a line or a disc of another hue beside the mark turns the weights away from its colour.
    strays = colors - X @ plane
    return plane, gram, strays.T @ strays / (len(rows) - 3) + ROUNDING * np.eye(3)


def _lopsided(alpha: np.ndarray, center: np.ndarray) -> np.ndarray:
    """Half of what alpha differs by from itself turned by 180 degrees about the centre, (h, w).

    A mark is its own image under that turn. What is left is noise, compression, wear: all that can move the centre.
    """
    turn = np.array([[-1.0, 0.0, 2.0 * center[0]], [0.0, -1.0, 2.0 * center[1]]])
    smooth = cv2.GaussianBlur(alpha, (3, 3), 0)
    flags, border = cv2.INTER_LANCZOS4 | cv2.WARP_INVERSE_MAP, cv2.BORDER_REPLICATE
    return (smooth - cv2.warpAffine(smooth, turn, alpha.shape[::-1], flags=flags, borderMode=border)) / 2.0


def _power(noise: np.ndarray, weights: np.ndarray, reach: int) -> float:
    """Sum of the noise's autocovariance over the lags in a square of width `reach`, not less than its variance.

    weights: how much each pixel's noise matters, (h, w), 0 where it is not to be looked at.
    The variance of a mean of n pixels is that sum over n. White noise: its variance. Grainy noise: more.
    """
    box = (reach, reach)
    weighted, w = noise * weights, weights.ravel()
    weight2 = float(w @ w)
    variance = float(cv2.norm(weighted, cv2.NORM_L2SQR)) / weight2
    pairs = float(weighted.ravel() @ cv2.boxFilter(weighted, -1, box, borderType=cv2.BORDER_CONSTANT).ravel())
    power = reach**2 * pairs / float(w @ cv2.boxFilter(weights, -1, box, borderType=cv2.BORDER_CONSTANT).ravel())
    n_pixels = float(w.sum()) ** 2 / weight2
    # White noise of n pixels gives the variance give or take reach / sqrt(n) of it: only more than that is grain.
    return power if power > variance * (1.0 + 2.0 * reach / np.sqrt(n_pixels)) else variance


def _ellipse(radius: int) -> np.ndarray:
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
