"""Three red marks in a picture, and where they are expected."""

import numpy as np

from vision import Disc, Expected, Lighting, Outline, draw_frame

SIZE = (640, 480)
HOMES = {"M1": (150.0, 120.0), "M3": (450.0, 130.0), "M4": (300.0, 350.0)}


def expected(places: dict[str, tuple[float, float]], sd: float = 3.0, hues_deg: dict[str, float] | None = None):
    """Marks of a radius of 10 px, red but for those of other hues."""
    outline = Outline(10.0 * np.eye(2), 0.05)
    hues = dict.fromkeys(places, 0.0) if hues_deg is None else hues_deg
    return [Expected(name, np.array(at), sd**2 * np.eye(2), hues[name], outline) for name, at in places.items()]


def frame(places: dict[str, tuple[float, float]], rng: np.random.Generator, *more: Disc, radius: float = 10.0):
    discs = [Disc(np.array(at), (radius, radius), 0.0) for at in places.values()]
    return draw_frame(SIZE, [*discs, *more], Lighting(), rng)
