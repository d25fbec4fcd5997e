"""Filmed real balls, tracked by colour and outline, and compared with centres labelled by people.

    python -m experiments.studies.real_balls ../shared/data --out DIR

The films are `ball.mp4` of github necrosskull/opencv_pendulum at 92aaf6f and `ball.mp4`, `ball3.mp4` of github
trflorian/ball-tracking-live-plot at 2c6270a (both MIT): a striped red ball on a cord, a green ball tossed and caught,
and a ball half covered by a hand. The hue of a ball is learned at one position in one frame. DIR gets real-balls.json,
and for each film a table of its frames. Latest figures: docs/real-film.md.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import filterpy.kalman as filterpy
import numpy as np
import pandas as pd
from filterpy.common import Q_continuous_white_noise

from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.outputs import output_folder, write_whole
from experiments.pipeline.track import Track
from experiments.studies.grid import command, print_figures
from vision import Detection, Expected, Frame, MarkFinder, MarkHue, Outline, VideoFileFrames, learn_hue

LABELS = Path(__file__).parents[1] / "labels" / "balls.csv"
"""Labels of balls, with the columns film, frame, u_px, v_px, radius_px, blurred, u_seen, v_seen, by.

u_seen: whether both edges of the ball along u are visible; v_seen: the same along v; by: person who labelled, 1 or 2"""


@dataclass(frozen=True, slots=True)
class Film:
    """A film of a ball, and how to find and follow the ball.

    path: path in the folder of real pictures
    click: number of a frame, and coordinates u, v of the ball in this frame [px]; radius_px: its radius in this frame
    jolt_px: amplitude density of the ball's white-noise acceleration in the picture [px/s²/sqrt(Hz)]
    focal_px: focal length of the camera, assumed as typical for telephones
    size_sd: relative sd of the expected size; follow_size: share of this size's error that a detection corrects
    """

    path: str
    click: tuple[int, float, float]
    radius_px: float
    jolt_px: float
    focal_px: float
    size_sd: float
    follow_size: float


FILMS = {
    "red-pendulum": Film("red-pendulum/ball.mp4", (150, 229.0, 536.0), 19.5, 3000.0, np.inf, 0.01, 0.01),
    "green-toss": Film("green-ball/ball.mp4", (25, 505.0, 58.0), 23.0, 6000.0, 950.0, 0.1, 0.1),
    "green-hand": Film("green-ball/ball3.mp4", (164, 1137.0, 80.0), 34.0, 3000.0, 950.0, 0.05, 0.1),
}

START_SD_PX = 5.0
"""Standard deviation of the given positions in the first frame on each axis [px]; choice."""
GONE = 10
"""After more frames than this without a detection, a mark is searched in the whole picture; choice."""
FASTEST_PX_S = 1500.0
"""Standard deviation of a mark's velocity when the mark is first detected [px/s]; choice."""


class PxFollower:
    """Tracks each mark in the picture separately, frame by frame. No model connects the marks.

    hues: colour range of each mark, by its name
    jolt_px: amplitude density of a mark's white-noise acceleration in the picture [px/s²/sqrt(Hz)]
    starts_px: known positions of marks in the first frame, (2,) for each mark; other marks may be anywhere
    filters: a Kalman filter for each mark that is followed, by the mark's name
    """

    def __init__(
        self, hues: Mapping[str, MarkHue], jolt_px: float, starts_px: Mapping[str, Floats] | None = None
    ) -> None:
        self.finder = MarkFinder(hues.values())
        self._hues, self._jolt_px = hues, jolt_px
        self._unseen = dict.fromkeys(hues, 0)
        self._time_s: float | None = None
        cov = START_SD_PX**2 * np.eye(2)
        self.filters = {name: _started(place, cov) for name, place in (starts_px or {}).items()}

    def see(self, frame: Frame, outlines: Mapping[str, Outline]) -> dict[str, Detection]:
        """The marks found in the next frame, by name; outlines: outline of each mark."""
        dt = 0.0 if self._time_s is None else frame.exposure_s - self._time_s
        self._time_s = frame.exposure_s
        if dt > 0.0:
            F = np.kron(np.array([[1.0, dt], [0.0, 1.0]]), np.eye(2))
            Q = np.kron(Q_continuous_white_noise(2, dt, spectral_density=self._jolt_px**2), np.eye(2))
            for each in self.filters.values():
                each.predict(F=F, Q=Q)
        height, width = frame.image.shape[:2]
        anywhere = np.array([width / 2.0, height / 2.0]), np.diag([width**2, height**2]) / 4.0
        expected = []
        for name, hue in self._hues.items():
            known = self.filters.get(name)
            mean, cov = anywhere if known is None else (known.x[:2], known.P[:2, :2])
            expected.append(Expected(name, mean, cov, hue.hue_deg, outlines[name]))
        found = {one.name: one.detection for one in self.finder.find(frame.image, expected)}
        for name in self._hues:
            self._take(name, found.get(name))
        return found

    def _take(self, name: str, seen: Detection | None) -> None:
        self._unseen[name] = 0 if seen is not None else self._unseen[name] + 1
        if seen is None:
            if self._unseen[name] > GONE:
                self.filters.pop(name, None)
        elif name in self.filters:
            self.filters[name].update(seen.center_px, R=seen.cov_px2, H=np.eye(2, 4))
        else:
            self.filters[name] = _started(seen.center_px, seen.cov_px2)


def _started(place_px: Floats, cov_px2: Floats) -> filterpy.KalmanFilter:
    started = filterpy.KalmanFilter(4, 2)
    started.x = np.array([*place_px, 0.0, 0.0])
    started.P = np.zeros((4, 4))
    started.P[:2, :2], started.P[2:, 2:] = cov_px2, FASTEST_PX_S**2 * np.eye(2)
    return started


def stretched(offset_px: Floats, focal_px: float) -> Floats:
    """Matrix, (2, 2), by which perspective stretches a ball's image; offset_px: from picture centre to ball, (2,)."""
    length = float(np.hypot(*offset_px))
    if length == 0.0:
        return np.eye(2)
    return np.eye(2) + (np.hypot(1.0, length / focal_px) - 1.0) * np.outer(offset_px, offset_px) / length**2


def followed(path: Path, film: Film) -> pd.DataFrame:
    """Track the ball in a film. A row for each frame: time, position, covariance, occlusion and radius of the ball."""
    with VideoFileFrames(path) as frames:
        clicked = next((frame for frame in frames if frame.index == film.click[0]), None)
    if clicked is None:
        raise InputError(f"{path}: expected a frame {film.click[0]}, found fewer")
    follower = PxFollower({"ball": learn_hue(clicked.image, film.click[1:])}, film.jolt_px)
    radius_px = film.radius_px
    rows = []
    with VideoFileFrames(path) as frames:
        for frame in frames:
            if not follower.filters:
                radius_px = film.radius_px
            known = follower.filters.get("ball")
            middle = (np.array(frame.image.shape[1::-1]) - 1.0) / 2.0
            offset = np.zeros(2) if known is None else known.x[:2] - middle
            outline = Outline(radius_px * stretched(offset, film.focal_px), film.size_sd, even=False)
            seen = follower.see(frame, {"ball": outline}).get("ball")
            row: dict[str, float | int | bool] = {"frame": frame.index, "time_s": frame.exposure_s}
            row["seen"] = seen is not None
            if seen is not None:
                (uu, uv), (_, vv) = seen.cov_px2
                row |= {"u_px": seen.center_px[0], "v_px": seen.center_px[1], "uu_px2": uu, "uv_px2": uv, "vv_px2": vv}
                row |= {"occluded": seen.occluded, "clipped": seen.clipped, "radius_px": radius_px * seen.size}
                if not seen.clipped:
                    radius_px *= seen.size**film.follow_size
            rows.append(row)
    return pd.DataFrame(rows)


def against_labels(rows: pd.DataFrame, labels: pd.DataFrame) -> dict[str, float]:
    """Errors of sharp balls relative to labels [px], along axes on which both edges of the ball are visible."""
    first = labels[labels.by == 1]
    both = first.merge(rows[rows.seen], on="frame", suffixes=("_label", ""))
    labelled = both[["u_seen", "v_seen"]].to_numpy(dtype=bool) & (both.blurred == 0).to_numpy()[:, None]
    errors = (both[["u_px", "v_px"]].to_numpy() - both[["u_px_label", "v_px_label"]].to_numpy())[labelled]
    variance = both[["uu_px2", "vv_px2"]].to_numpy(dtype=float)[labelled]
    twice = first.merge(labels[labels.by == 2], on="frame", suffixes=("", "_again"))
    again = (twice[["u_px", "v_px"]].to_numpy() - twice[["u_px_again", "v_px_again"]].to_numpy()).ravel()
    return {
        "labels": len(first),
        "found": len(both),
        "coordinates": int(labelled.sum()),
        "rms_px": float(np.sqrt((errors**2).mean())),
        "median_px": float(np.median(np.abs(errors))),
        "sigma_px": float(np.sqrt(variance.mean())),
        "label_scatter_px": float(np.sqrt((again**2).mean() / 2.0)) if len(again) else np.nan,
    }


def tracked_against_labels(seen: Track, film: str) -> dict[str, float]:
    """Figures of `against_labels` for a track with one mark; film: name of the film in the labels."""
    camera = seen.recording.scene.cameras[0]
    rows: list[dict[str, float | bool]] = []
    for k, step in enumerate(seen.steps):
        for mark in step.marks:
            (u, v), ((uu, _), (_, vv)) = camera.project(mark.position)[0], camera.cov_to_px(mark.position, mark.cov)[0]
            rows.append({"frame": k, "seen": True, "u_px": u, "v_px": v, "uu_px2": uu, "vv_px2": vv})
    labels = pd.read_csv(LABELS)
    return against_labels(pd.DataFrame(rows), labels[labels.film == film])


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Track the ball of every film, and write the tables. If a film has labels, print the errors relative to them."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path, help="folder of the real pictures")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args(arguments)
    labels, figures = pd.read_csv(LABELS), {}
    with output_folder(given.out, force=True, inputs=[given.data]) as folder:
        for name, film in FILMS.items():
            rows, own = followed(given.data / film.path, film), labels[labels.film == name]
            write_whole(folder / f"{name}.csv", rows.to_csv(index=False, float_format="%.4f"))
            if len(own):
                figures[name] = against_labels(rows, own)
                print_figures(f"{name}: ", figures[name])
        write_whole(folder / "real-balls.json", json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
