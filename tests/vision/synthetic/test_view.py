"""Drawn views against closed forms: rays, ellipses, areas and centres of discs on a tilted plane."""

import numpy as np
import pytest

from vision import SyntheticView, tilted_view
from vision.synthetic.view import disc_box, disc_coverage

SIZE = (640, 480)
BENT = (-0.28, 0.09, 0.001, -0.0015, 0.01)


def region_on_rim(view: SyntheticView, center_m: np.ndarray, radius_m: float) -> tuple[float, np.ndarray]:
    """Area and centroid of a disc's picture [px], from 20,000 points of its rim: Green's theorem."""
    angle = np.linspace(0.0, 2.0 * np.pi, 20_000, endpoint=False)
    rim = view.project(center_m + radius_m * np.column_stack([np.cos(angle), np.sin(angle)]))
    near = rim.mean(axis=0)
    a, b = rim - near, np.roll(rim - near, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
    return abs(cross.sum() / 2.0), near + ((a + b) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum())


def drawn_region(view: SyntheticView, center_m: np.ndarray, radius_m: float) -> tuple[float, np.ndarray]:
    path = np.atleast_2d(center_m)
    box = disc_box(view, path, radius_m)
    alpha = disc_coverage(view, box, path, radius_m)
    v, u = np.indices(alpha.shape)
    return alpha.sum(), np.array([(u * alpha).sum(), (v * alpha).sum()]) / alpha.sum() + box[:2]


@pytest.mark.parametrize("distortion", [(0.0,) * 5, BENT])
@pytest.mark.parametrize("tilt_deg", [(0.0, 0.0, 0.0), (25.0, -20.0, 10.0)])
@pytest.mark.parametrize("center_m", [(0.0, 0.0), (0.2013, 0.1507), (-0.2302, 0.1404)])
def test_a_disc_has_its_area_and_centroid(distortion: tuple, tilt_deg: tuple, center_m: tuple) -> None:
    view = tilted_view(SIZE, 620.0, 1.0, tilt_deg=tilt_deg, distortion=distortion)
    area, centroid = drawn_region(view, np.array(center_m), 0.0123)
    true_area, true_centroid = region_on_rim(view, np.array(center_m), 0.0123)
    assert area == pytest.approx(true_area, rel=5e-4)
    # Whole pixels hold the centroid of this radius to 1.5e-3 px, however exact their shares are.
    np.testing.assert_allclose(centroid, true_centroid, atol=2e-3)


def test_a_place_is_seen_where_its_ray_ends() -> None:
    view = tilted_view(SIZE, 620.0, 1.0, tilt_deg=(25.0, -20.0, 10.0), distortion=BENT)
    places = np.random.default_rng(0).uniform((0, 0), SIZE, (50, 2))
    np.testing.assert_allclose(view.project(view.to_plane(places)), places, atol=1e-6)
    # Distortion by Brown's formula at one ray.
    x, y = view.rays([[600.0, 60.0]])[0]
    r2, (k1, k2, p1, p2, k3) = x * x + y * y, BENT
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = 319.5 + 620.0 * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x))
    v = 239.5 + 620.0 * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y)
    np.testing.assert_allclose([u, v], [600.0, 60.0], atol=1e-6)


def test_bad_views_are_refused() -> None:
    good = tilted_view(SIZE, 600.0, 1.0)
    with pytest.raises(ValueError, match="view rotation: expected a rotation"):
        SyntheticView(SIZE, good.matrix, np.diag([1.0, 1.0, -1.0]), good.translation_m)
    with pytest.raises(ValueError, match="view matrix: expected finite numbers of shape"):
        SyntheticView(SIZE, np.eye(2), good.rotation, good.translation_m)
    with pytest.raises(ValueError, match="expected the lens off the plane"):
        SyntheticView(SIZE, good.matrix, good.rotation, np.zeros(3))
    with pytest.raises(ValueError, match="view distortion: expected five finite numbers"):
        SyntheticView(SIZE, good.matrix, good.rotation, good.translation_m, (0.1,))
    steep = tilted_view(SIZE, 600.0, 1.0, tilt_deg=(80.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="expected points before the lens"):
        steep.project([[0.0, -50.0], [0.0, 50.0]])
    with pytest.raises(ValueError, match="expected places before the horizon"):
        steep.to_plane([[320.0, 0.0], [320.0, 479.0]])
