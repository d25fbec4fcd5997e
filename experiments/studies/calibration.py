"""Study of a camera whose calibration error is constant in a run: error and covariance of the estimated target.

`experiments.simulation.simulate` computes the truth. Runs last 5 s at 30 frames/s; the first 0.5 s is not evaluated.
The camera is 1.2 m from the plane of the marks. The errors of its lens and pose are drawn once for each run. They are
scaled so that the rms displacement of the marks has a given length. Marks also have 0.5 mm of noise. Two filters get
the same marks. The filter `independent` assumes that marks have new, independent errors in each frame. The filter
`considered` takes the constant error of the calibration into account.

`python -m experiments.studies.calibration` does 100 runs of each case, and prints a table with these columns (latest
figures in docs/calibration.md):

    camera  scenario  error  filter  rms error  rms sigma  in 95 % region  mean NEES
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from dynamics import HIDDEN, OUTER, four_mass_phantom
from estimators import TissueFilter, coverage, normalised_error_squared
from experiments.arrays import Floats
from experiments.studies.estimation.trials import EXACTLY, Trial, passed, seen
from experiments.studies.grid import print_figures, runs_of, seeds_of, study_options
from vision import Lens, PlaneCamera, Pose, posed_camera

MARK_SD_M = 0.0005
ERRORS_M = (0.0003, 0.001, 0.002)
SETTLED = 15
"""Number of frames at the start of a run that are not evaluated."""

FILTERS = (INDEPENDENT, CONSIDERED) = "independent", "considered"

WHOLE, TURNED = "whole", "turned"
DIRECTIONS = {
    WHOLE: np.diag([3.0, 3.0, 3.0, 3.0, 0.01, 0.02, 1e-3, 1e-3, 0.02, *[2e-3] * 3, *[2e-3] * 3]),
    TURNED: np.diag([0.0] * 11 + [5e-3, 1e-3, 1e-3, 5e-3])[11:],
}
"""Independent errors of lens and pose, one per row; columns: see `Calibration.uncertainty`; choice. WHOLE: errors as
after a calibration with a dozen pictures. TURNED: the lens is exact; the rotation about the optical axis and the
position are wrong. `miscalibrated_camera` scales the errors."""
CASES = (
    *((WHOLE, scenario, error_m) for scenario in ("quiet", "poked") for error_m in ERRORS_M),
    (TURNED, "quiet", 0.002),
)


Run = dict[str, tuple[Floats, Floats]]
"""Results of one run by name of the filter: errors [m], (n_frames, 2), and covariances [m²], (n_frames, 2, 2)."""


def miscalibrated_camera(error_m: float, kind: str) -> PlaneCamera:
    """A camera in front of the phantom; error_m: rms displacement of marks at rest by the calibration error [m]."""
    lens = Lens(np.array([[900.0, 0.0, 639.5], [0.0, 900.0, 359.5], [0.0, 0.0, 1.0]]), np.zeros(5))
    camera = posed_camera(
        "front",
        (1280, 720),
        lens,
        Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.2, 1.2])),
        calibration=DIRECTIONS[kind],
    )
    network = four_mass_phantom()
    moved = camera.calibration_error([network.positions[network.index(node)] for node in OUTER])
    rms = np.sqrt((moved**2).sum() / len(OUTER))
    return replace(camera, calibration=camera.calibration * error_m / rms)


def run(seed: int, case: tuple[str, str, float], cache: Path, duration_s: float = 5.0) -> Run:
    """Run both filters on the same marks; case: one of `CASES`."""
    kind, scenario, error_m = case
    rng = np.random.default_rng([seed, round(1e6 * error_m)])
    trial = Trial(scenario, seed, duration_s=duration_s, mark_sd_m=MARK_SD_M)
    given, hidden = seen(trial, cache, rng)
    camera = miscalibrated_camera(error_m, kind)
    theta = rng.normal(size=len(camera.calibration))
    frames = []
    for time_s, marks in given:
        shared = camera.calibration_error([mark.position for mark in marks])
        off = [replace(m, position=m.position + F @ theta, shared=F) for m, F in zip(marks, shared, strict=True)]
        frames.append((time_s, off))
    found: Run = {}
    for name in FILTERS:
        n = 0 if name == INDEPENDENT else len(theta)
        tissue = TissueFilter(four_mass_phantom(), HIDDEN, OUTER, EXACTLY, n_calibration=n)
        estimates = passed(tissue, frames)[SETTLED:]
        errors = np.array([one.mean for one in estimates]) - hidden[SETTLED:]
        found[name] = errors, np.array([one.cov for one in estimates])
    return found


def figures(runs: list[Run], name: str) -> dict[str, float]:
    """Figures of one filter over all runs: rms error [mm], rms standard deviation [mm], coverage, and mean NEES."""
    errors, covs = (np.concatenate(parts) for parts in zip(*(one[name] for one in runs), strict=True))
    nees = normalised_error_squared(errors, covs)
    return {
        "error_mm": 1e3 * float(np.sqrt((errors**2).sum(axis=1).mean())),
        "sigma_mm": 1e3 * float(np.sqrt(np.trace(covs, axis1=1, axis2=2).mean())),
        "coverage95": coverage(nees, 2),
        "mean_nees": float(nees.mean()),
    }


def main() -> None:
    """Print the table."""
    parser = study_options(__doc__, out=False, seeds=(100, 7000), runs="--runs")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES:
            work = partial(run, case=case, cache=Path(folder))
            runs = runs_of(work, seeds_of(given), given)
            for name in FILTERS:
                label = f"{case[0]:6} {case[1]:6} {1e3 * case[2]:g} mm  {name:15} "
                print_figures(label, figures(runs, name))


if __name__ == "__main__":
    main()
