"""A filmed red ball on a cord: a test of the filter's covariance on real data.

The film is `ball.mp4` of github necrosskull/opencv_pendulum at 92aaf6f (MIT): 334 frames, 360x640, 29.9 frames/s. A
hand releases the ball. The ball swings, hits a wall just before its lowest point, and finally leans on the wall. The
model has one fixed node, one mass and one stiff spring. It has no wall; the wall acts as an unknown force.

    python -m experiments.studies.red_pendulum ball.mp4 --out DIR

The command makes DIR/recording for `softaim track`, and tracks it. Then the filter does not get the mark for 0.3 s in
each second, and its predictions are compared with the measured positions. DIR gets report.json and withheld.png. Latest
figures: docs/real-film.md.

The plane of the swing is rotated about the vertical, relative to the picture's plane. The angle of this rotation is the
only unknown of the homography from plane to picture. The scale follows from gravity and the frequency w of the swing.
Between two impacts on the wall, the ball swings freely, and its angle theta obeys
theta'' = -w² sin(theta - theta_0) - 2 c theta', where theta_0 is the rest angle and c the damping. The fit has the same
w for all free flights. The cord's length is 9.81 / w².
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.integrate import odeint
from scipy.optimize import least_squares

import vision
from dynamics import build_network
from estimators import coverage, normalised_error_squared
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.marks.rows import MarkRow
from experiments.formats.outputs import output_folder
from experiments.formats.recording import read_recording, write_frames_csv, write_marks_csv
from experiments.formats.scene.scene import Mark, Scene, Target, write_scene
from experiments.pipeline.line import FILTER
from experiments.pipeline.track import Track, track
from experiments.plots.style import OURS, PAGE_MM, TRUE, ellipse, grid_figure, legend_below, styled, write_picture
from experiments.studies.grid import command
from experiments.studies.real_balls import FILMS, followed, tracked_against_labels

GRAVITY = 9.81
HOOK_PX = (306.0, 102.0)  # read from the film: where the cord leaves the hook
FOCAL_PX = 500.0  # chosen: focal length of a telephone's camera held upright, 360 px wide
BALL_PX = 38.6  # diameter of the ball, mean of its rim in all frames (experiments.studies.real_balls)
FIRST_FREE = 9  # the frame after which the hand has released the ball, read from the film
HUE_DEG = 15.7  # learned by `vision.learn_hue` from the ball's centre in frame 150
MASS_KG = 0.05  # chosen: positions do not depend on it, forces are stated per mass
STIFFNESS_N_M = 60.0  # chosen: the swing leaves the plane, and the cord's length in the picture varies by 5 mm
DAMPING_N_S_M = 0.5  # chosen
CALIBRATION_SD_PX = 0.5  # chosen with labels: predicted error of marks 0.70 px, observed 0.61 px
WITHHELD_S, EVERY_S, OFFSETS_S = 0.3, 1.0, (0.25, 0.5, 0.75, 1.0)
SHORTEST_FLIGHT = 8  # frames
BALL, HOOK = "ball", "hook"


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """Plane in which the ball swings. Its origin is the hook. Its unit is the height that a pixel covers at the hook.

    narrowing: cosine of the angle between this plane and the picture's plane
    nearing: relative increase of the distance from the camera if a point moves by one unit to the right
    center_px: intersection of the optical axis with the picture, (2,)
    radius_px: length of the cord in units of the plane
    """

    narrowing: float
    nearing: float
    center_px: Floats
    radius_px: float

    def to_px(self, units_per_m: float = 1.0) -> Floats:
        """Homography from the plane to the picture, (3, 3); units_per_m: factor that converts input to plane units."""
        (u0, v0), (u, v), q = HOOK_PX, self.center_px, self.nearing
        unit = np.array([[u * q + self.narrowing, 0.0, u0], [v * q, -1.0, v0], [q, 0.0, 1.0]])
        return unit @ np.diag([units_per_m, units_per_m, 1.0])

    def seen(self, angles: Floats) -> Floats:
        """Positions of the ball in the picture [px], (n_angles, 2), for angles of the cord from the vertical [rad]."""
        places = self.radius_px * np.stack(
            [np.sin(angles), -np.cos(angles), np.full(len(angles), 1.0 / self.radius_px)]
        )
        mapped = self.to_px() @ places
        return (mapped[:2] / mapped[2]).T


@dataclass(frozen=True, slots=True, eq=False)
class Swing:
    """The fitted pendulum: angular frequency [rad/s], angle between cord at rest and vertical [rad], damping [1/s].

    rms_px: rms residual of the fit [px]; strikes: numbers of the frames in which the ball hits the wall
    """

    frequency: float
    rest_angle: float
    damping: float
    plane: Plane
    rms_px: float
    strikes: tuple[int, ...]

    @property
    def length_m(self) -> float:
        """Length of the cord [m]: gravity divided by the squared angular frequency."""
        return GRAVITY / self.frequency**2

    @property
    def mm_per_px(self) -> float:
        """Vertical length that a pixel covers at the hook [mm]."""
        return 1e3 * self.length_m / self.plane.radius_px


def seen_centers(film: Path) -> tuple[Floats, Floats]:
    """Exposure times [s], (n_frames,), and ball centres [px], (n_frames, 2). InputError if a frame shows no ball."""
    rows = followed(film, FILMS["red-pendulum"])
    if not rows.seen.all():
        raise InputError(f"{film}: frame {rows.frame[~rows.seen].iloc[0]}: expected a red ball, found none")
    return rows.time_s.to_numpy(), rows[["u_px", "v_px"]].to_numpy()


def fitted_swing(times_s: Floats, centers_px: Floats, size_px: tuple[int, int], n_flights: int = 10) -> Swing:
    """Fit the pendulum and the angle of its plane to the ball's positions in the first n_flights free flights."""
    center_px = (np.array(size_px) - 1.0) / 2.0
    strikes = _strikes(centers_px[:, 0])
    ends = pairwise([FIRST_FREE, *strikes])
    flights = [np.arange(a + 2, b - 1) for a, b in ends if b - a > SHORTEST_FLIGHT][:n_flights]
    if len(flights) < 2:
        raise InputError(f"film: expected a ball that swings freely at least twice, found {len(flights)} swings")

    def parts(p: Floats) -> tuple[Plane, Floats]:
        plane = Plane(float(np.cos(p[0])), float(np.sin(p[0]) / FOCAL_PX), center_px, float(p[1]))
        angles = [_swung(times_s[f], p[5 + 2 * k : 7 + 2 * k], *p[2:5]) for k, f in enumerate(flights)]
        return plane, np.concatenate(angles)

    def left_over(p: Floats) -> Floats:
        plane, angles = parts(p)
        return (plane.seen(angles) - centers_px[np.concatenate(flights)]).ravel()

    away = centers_px - HOOK_PX
    angles = np.arctan2(away[:, 0], away[:, 1])
    starts = [(angles[f[0]], (angles[f[1]] - angles[f[0]]) / (times_s[f[1]] - times_s[f[0]])) for f in flights]
    first = np.concatenate([[0.2, float(np.median(np.linalg.norm(away, axis=1))), 4.5, 0.0, 0.1], np.ravel(starts)])
    fit = least_squares(left_over, first, x_scale="jac", loss="soft_l1")
    plane, _ = parts(fit.x)
    rms_px = float(np.sqrt((left_over(fit.x) ** 2).mean()))
    return Swing(float(fit.x[2]), float(fit.x[3]), float(fit.x[4]), plane, rms_px, tuple(strikes))


def _swung(times_s: Floats, start: Floats, w: float, rest: float, damping: float) -> Floats:
    def slope(y: Floats, _t: float) -> tuple[float, float]:
        return y[1], -w * w * math.sin(y[0] - rest) - 2.0 * damping * y[1]

    return np.asarray(odeint(slope, start, times_s, rtol=1e-6, mxstep=10_000)[:, 0])


def _strikes(u: Floats) -> list[int]:
    """Frames in which the ball hits the wall: the ball moves to the right before, and to the left afterwards."""
    return [
        k
        for k in range(FIRST_FREE, len(u) - 4)
        if u[k] >= u[k - 1] and u[k] >= u[k + 1] and min(u[k] - u[k - 4], u[k] - u[k + 4]) > 12.0
    ]


def pendulum_scene(swing: Swing, size_px: tuple[int, int]) -> Scene:
    """Scene with a fixed node at the origin, a mass and a stiff spring. Gravity is tilted by the rest angle."""
    down = np.array([np.sin(swing.rest_angle), -np.cos(swing.rest_angle)])
    network = build_network(
        [HOOK, BALL],
        np.array([[0.0, 0.0], swing.length_m * down]),
        [(HOOK, BALL)],
        stiffness=STIFFNESS_N_M,
        damping=DAMPING_N_S_M,
        masses=MASS_KG,
        drag=[0.0, 2.0 * swing.damping * MASS_KG],
        fixed=[HOOK],
        rest_lengths=swing.length_m - MASS_KG * GRAVITY / STIFFNESS_N_M,
        gravity=GRAVITY * down,
    )
    camera = vision.PlaneCamera("film", size_px, swing.plane.to_px(1e3 / swing.mm_per_px), CALIBRATION_SD_PX)
    ball_m = BALL_PX / camera.ball_shape(network.positions[1], 1.0)[0, 0]
    ball = Mark(BALL, HUE_DEG, ball_m, half_width_deg=8.0, min_saturation=0.3, even=False, ball=True)
    return Scene(network, (ball,), Target(BALL, ball_m / 2), (camera,))


def write_recording(film: Path, folder: Path) -> Swing:
    """Convert the film to a recording in an existing folder; returns the fitted pendulum."""
    with vision.VideoFileFrames(film) as frames:
        height, width = next(iter(frames)).image.shape[:2]
    times, centers = seen_centers(film)
    swing = fitted_swing(times, centers, (width, height))
    write_scene(pendulum_scene(swing, (width, height)), folder / "scene.toml")
    write_frames_csv(folder / "frames.csv", times)
    shutil.copyfile(film, folder / f"video{film.suffix}")
    return swing


def withheld_frames(times_s: Floats, offset_s: float) -> NDArray[np.bool_]:
    """Mask of the frames without the mark, (n_frames,): the first 0.3 s of each second, counted from offset_s [s]."""
    since = times_s - offset_s
    return (since >= 0.0) & (since % EVERY_S < WITHHELD_S - 1e-9)


def write_withheld(seen: Track, offset_s: float, folder: Path) -> NDArray[np.bool_]:
    """Write a recording of the found marks, without marks in `withheld_frames`; returns the mask of these frames."""
    times = seen.times_s
    hidden = withheld_frames(times, offset_s)
    rows = [
        [MarkRow(m.node, m.position, float(np.sqrt(np.trace(m.cov) / 2))) for m in ([] if kept_back else step.marks)]
        for step, kept_back in zip(seen.steps, hidden, strict=True)
    ]
    write_scene(seen.recording.scene, folder / "scene.toml")
    write_frames_csv(folder / "frames.csv", times)
    write_marks_csv(folder / "marks.csv", times, rows, dim=2)
    return hidden


def compared(seen: Track, folder: Path, strikes: Sequence[int]) -> tuple[dict[str, dict[str, float]], list[Track]]:
    """Track with withheld marks, once for each of `OFFSETS_S`. Returns figures by state of the ball, and all tracks."""
    places = np.array([step.marks[0].position for step in seen.steps])
    mark_covs = np.array([step.marks[0].cov for step in seen.steps])
    errors, covs, kinds, runs = [], [], [], []
    for k, offset_s in enumerate(OFFSETS_S):
        part = folder / f"withheld-{k}"
        part.mkdir()
        hidden = write_withheld(seen, offset_s, part)
        done = track(read_recording(part))
        runs.append(done)
        estimates = done.estimates(FILTER)
        for i in np.flatnonzero(hidden):
            errors.append(estimates[i].mean - places[i])
            # the measurement has an error, too
            covs.append(np.asarray(estimates[i].cov) + mark_covs[i])
            kinds.append(_kind(int(i), hidden, strikes))
    return _figures(np.array(errors), np.array(covs), np.array(kinds)), runs


def _kind(frame: int, hidden: NDArray[np.bool_], strikes: Sequence[int]) -> str:
    """State of the ball while its mark is withheld: "held" by the hand, "flying", "after impact", or "leaning"."""
    first = frame - int(np.argmin(hidden[frame::-1]))
    if frame <= FIRST_FREE:
        return "held"
    if first > strikes[-1]:
        return "leaning"
    return "after impact" if any(first <= s <= frame + 1 for s in strikes) else "flying"


def _figures(errors: Floats, covs: Floats, kinds: NDArray[np.str_]) -> dict[str, dict[str, float]]:
    nees = normalised_error_squared(errors, covs)
    figures = {}
    for kind in ("all", "flying", "after impact", "leaning"):
        of = np.ones(len(kinds), dtype=bool) if kind == "all" else kinds == kind
        if of.any():
            figures[kind] = {
                "frames": int(of.sum()),
                "mae_mm": 1e3 * float(np.linalg.norm(errors[of], axis=1).mean()),
                "coverage95": coverage(nees[of], 2),
                "mean_nees": float(nees[of].mean()),
            }
    return figures


@styled
def withheld_figure(seen: Track, runs: Sequence[Track]) -> Figure:
    """Pictures of the film with measured and estimated positions of the withheld mark, and with 2-sigma ellipses."""
    camera = seen.recording.scene.cameras[0]
    with seen.recording.open_frames() as frames:
        image = next(iter(frames)).image[..., ::-1]
    figure, axes = grid_figure(PAGE_MM, 90.0, nrows=2, ncols=2)
    for ax, run, offset_s in zip(axes.ravel(), runs, OFFSETS_S, strict=True):
        ax.imshow(image)
        hidden = withheld_frames(run.times_s, offset_s)
        places = camera.project(np.array([step.marks[0].position for step in seen.steps]))
        means_m, covs_m2 = (np.array([getattr(e, key) for e in run.estimates(FILTER)]) for key in ("mean", "cov"))
        means, covs = camera.project(means_m), camera.cov_to_px(means_m, covs_m2)
        for k in np.flatnonzero(hidden)[2::4]:
            ax.add_patch(ellipse(means[k], covs[k], 2.0, ec=OURS, fc="none", lw=0.6))
            ax.plot(*np.stack([means[k], places[k]]).T, color=OURS, lw=0.4)
        ax.plot(*means[hidden].T, ".", color=OURS, ms=2.5, label="filter, mark withheld, with 2-sigma ellipses")
        ax.plot(*places[hidden].T, ".", color=TRUE, ms=2, label="seen")
        ax.set(xlim=(-0.5, image.shape[1] - 0.5), ylim=(620, 430), title=f"withheld 0.3 s from {offset_s:g} s on")
        ax.set(xlabel="u [px]", ylabel="v [px]")
    legend_below(figure, axes[0, 0], 2)
    return figure


def report(film: Path, out: Path, *, force: bool = False) -> dict[str, object]:
    """Write the output to `out`; returns the figures of report.json. Raises InputError if a frame lacks the ball."""
    with output_folder(out, force=force, inputs=[film]) as folder:
        (folder / "recording").mkdir()
        swing = write_recording(film, folder / "recording")
        seen = track(read_recording(folder / "recording"))
        found = sum(bool(step.marks) for step in seen.steps)
        if found < len(seen.steps):
            raise InputError(f"{film}: expected the ball in all {len(seen.steps)} frames, found it in {found}")
        withheld, runs = compared(seen, folder, swing.strikes)
        figures: dict[str, object] = {
            "frames": len(seen.steps),
            "frames_found": found,
            "mm_per_px": swing.mm_per_px,
            "cord_m": swing.length_m,
            "turn_deg": float(np.degrees(np.arccos(swing.plane.narrowing))),
            "flights_rms_px": swing.rms_px,
            "damping_per_s": swing.damping,
            "rest_angle_deg": float(np.degrees(swing.rest_angle)),
            "labels": tracked_against_labels(seen, "red-pendulum"),
            "withheld": withheld,
        }
        (folder / "report.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
        write_picture(withheld_figure(seen, runs), folder / "withheld.png")
    return figures


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Make the report and print its figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("film", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--force", action="store_true")
    given = parser.parse_args(arguments)
    try:
        print(json.dumps(report(given.film, given.out, force=given.force), indent=2))
    except vision.SourceError as error:
        raise InputError(str(error)) from error


if __name__ == "__main__":
    sys.exit(main())
