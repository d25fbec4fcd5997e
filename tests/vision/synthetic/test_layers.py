"""Layers over a picture: what they paint, what they take, and where the picture ends."""

import numpy as np
import pytest

from vision import Layer
from vision.synthetic.layers import paint, take


def test_a_layer_takes_its_share_of_each_pixel() -> None:
    picture = np.full((4, 5, 3), 0.2, dtype=np.float32)
    alpha = np.array([[0.0, 0.5, 1.0]])
    paint(picture, Layer(1, 2, alpha, np.array([1.0, 0.6, 0.0], dtype=np.float32)))
    np.testing.assert_allclose(picture[2, 1:4], [[0.2, 0.2, 0.2], [0.6, 0.4, 0.1], [1.0, 0.6, 0.0]], atol=1e-6)
    untouched = np.ones((4, 5), dtype=bool)
    untouched[2, 2:4] = False
    assert (picture[untouched] == np.float32(0.2)).all()


@pytest.mark.parametrize(
    ("left", "top", "seen"), [(-1, -1, 4), (3, 2, 4), (-3, 0, 0), (40, 40, 0), (1, 1, 9), (-2, 3, 1)]
)
def test_the_picture_cuts_a_layer(left: int, top: int, seen: int) -> None:
    colors = np.arange(27, dtype=np.float32).reshape(3, 3, 3)
    picture, free = np.full((4, 5, 3), -1.0, dtype=np.float32), np.ones((4, 5), dtype=np.float32)
    layer = Layer(left, top, np.ones((3, 3)), colors)
    paint(picture, layer)
    assert take(free, layer) == seen
    assert (free == 0).sum() == (picture[:, :, 0] >= 0).sum() == seen
    for v, u in np.argwhere(free == 0):
        assert picture[v, u].tolist() == colors[v - top, u - left].tolist()


def test_colours_of_another_shape_are_refused() -> None:
    with pytest.raises(ValueError, match="layer: expected alpha"):
        Layer(0, 0, np.ones((3, 3)), np.zeros((2, 3, 3)))
