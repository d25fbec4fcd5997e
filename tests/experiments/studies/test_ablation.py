"""The study of the filter's mechanisms: every switch acts, what would go is there, and the table is right."""

from functools import cache

import numpy as np
import pandas as pd
import pytest

from dynamics import four_mass_phantom
from estimators import FilterSettings, TissueFilter
from experiments.studies.ablation import __main__ as study
from experiments.studies.ablation.__main__ import BODIES, cases, main
from experiments.studies.ablation.run import run
from experiments.studies.ablation.switches import OFF, SWITCHES, TOGETHER, WHOLE, turned_off
from experiments.studies.ablation.table import FIGURES, rows_of

ACTS_ON = {
    "restart inflation": ("poked, tenth", 4.0),
    "restarts": ("poked, tenth", 4.0),
    "MANY_BLOWS": ("poked, tenth", 4.0),
    "with_outliers": ("poked, tenth", 4.0),
    "gate_marks": ("poked, outliers", 4.0),
    "gate_start": ("poked, outliers", 4.0),
    "confirmed": ("poked, blows", 8.0),
    "narrowed points": ("poked, blows", 8.0),
    "widest mode": ("phantom, wrong", 3.0),
    "ADDED_SHARE": ("poked, camera", 2.0),
    "CommonErrors": ("poked, camera", 2.0),
    "marks_bounds": ("poked, stated", 2.0),
    "AssociationFilter": ("poked, names", 4.5),
    "model_only": ("poked, gaps", 4.9),
    "LeaveOneOut.scale": ("wrong springs", 3.0),
    "reach of the target": ("chain2", 1.0),
    "softened links": ("chain2", 1.0),
    "evened_each": ("chain2", 1.0),
    "memory by swings": ("cable-fast", 0.5),
    "CROWD": ("block27", 2.0),
    "refuted": ("block27", 2.0),
    "led_inflation": ("block27", 2.0),
    "iterated update": ("chain2", 1.0),
}
"""Recordings on which a switch acts, where it does not on the usual one of its kind, and how long they must be [s]."""

WITHOUT_EFFECT = {"hand_strain"}
"""Switches that change nothing in the quick recordings."""

USUAL = {"soft": ("poked, outliers", 4.0), "stiff": ("block27", 0.7)}


class DiffersError(BaseException):
    """The filter gave something else than the whole one; no study takes that for a fault of the filter."""


def run_seen(off, body, seconds, seen):
    """The figures of a run; seen(mean, covariance and status) is called with what each update gives."""
    update = TissueFilter.update

    def seeing(tissue, *args, **options):
        estimate = update(tissue, *args, **options)
        seen((estimate.mean.tobytes(), estimate.cov.tobytes(), estimate.status))
        return estimate

    _, study_of, of, _ = BODIES[body]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TissueFilter, "update", seeing)
        patch.setattr(f"{run.__module__}._load_kernels", lambda: None)  # no run is timed here
        found = run({"study": study_of, "of": of, "seed": 700, "off": off, "seconds": seconds})
    return {name: found[name] for name in FIGURES}


@cache
def whole(body, seconds):
    """What each update of the whole filter gives, and the figures."""
    given = []
    return given, run_seen(WHOLE, body, seconds, given.append)


def changes(off, body, seconds):
    """Whether it gives something else without a mechanism; the run ends where it does."""
    given, figures = whole(body, seconds)
    expected = iter(given)

    def compare(estimate):
        if estimate != next(expected, None):
            raise DiffersError

    try:
        return run_seen(off, body, seconds, compare) != figures
    except DiffersError:
        return True


@pytest.mark.slow
@pytest.mark.parametrize("name", SWITCHES)
def test_a_switch_changes_what_the_filter_gives(name):
    where = ACTS_ON.get(name) or USUAL[SWITCHES[name].kinds.rsplit(" ", maxsplit=1)[-1]]
    assert changes(name, *where) == (name not in WITHOUT_EFFECT)


def test_every_switch_is_described_and_all_that_would_go_is_there():
    assert set(OFF) == {WHOLE, *SWITCHES}
    for one in SWITCHES.values():
        assert one.what
        assert set(one.kinds.split()) <= {"soft", "stiff", "checked"}
        assert all(0 < n <= last - first + 1 for _, first, last, n in one.found)


def test_the_filter_is_whole_again_afterwards():
    before = TissueFilter.__init__
    with turned_off(TOGETHER.join(["calm", "marks_bounds"])):
        made = TissueFilter(four_mass_phantom(), "M2", ("M1", "M3", "M4"), FilterSettings(marks_bounds=(0.5, 2.0)))
        assert (made.settings.calm_s, made.settings.marks_bounds) == (1.5, (1.0, 1.0))
    assert TissueFilter.__init__ is before


def table(**without):
    """Two bodies with the whole filter and without a mechanism, whose figures on the second body are these."""
    plain = dict(zip(FIGURES, (1e-3, 0.95, 1.0, 0, 0, 0, ""), strict=True)) | {"cpu_s": 1.0, "seed": 700}
    rows = [{**plain, "body": body, "off": off} for off in (WHOLE, "calm") for body in ("a", "b")]
    rows[-1] |= without
    return pd.DataFrame(rows)


@pytest.mark.parametrize(
    ("without", "verdict"),
    [
        ({}, "no effect"),
        ({"error_m": 1.05e-3}, "may go"),
        ({"error_m": 1.07e-3}, "stays"),
        ({"covered": 0.92}, "may go"),
        ({"covered": 0.90}, "stays"),
        ({"covered": 1.0}, "may go"),
        ({"wrong": 9}, "may go"),
        ({"wrong": 10}, "stays"),
        ({"failed": "LinAlgError", "error_m": np.nan, "nees": np.nan}, "stays"),
        ({"model_only": 1}, "may go"),
    ],
)
def test_a_mechanism_stays_that_is_worth_3_percent_2_points_or_a_row_of_faults(without, verdict):
    assert rows_of(table(**without))["verdict"].tolist() == [verdict]


def test_means_over_bodies_are_geometric_and_the_worst_is_named():
    (row,) = rows_of(table(error_m=1.21e-3, covered=0.85, lost=3)).itertuples()
    assert (row.error, row.covered) == pytest.approx((1.1, -5.0))
    assert (row.most, row.least) == ((pytest.approx(1.21), "b"), (pytest.approx(-10.0), "b"))
    assert (row.lost, row.changed, row.bodies) == (3, 1, 2)


def test_a_switch_is_run_on_bodies_of_its_kind_beside_the_whole_filter():
    found = cases(["Scales", TOGETHER.join(["Scales", "with_outliers"])], [700], None, quick=True)
    by_off = {off: {one["body"] for one in found if one["off"] == off} for off in {one["off"] for one in found}}
    bodies = {kind: {body for body, one in BODIES.items() if one[0] == kind} for kind in ("soft", "stiff", "checked")}
    both = bodies["soft"] | bodies["stiff"] - {"lung"}
    assert by_off == {
        WHOLE: both | bodies["checked"],
        "Scales": bodies["stiff"] - {"lung"},
        "Scales + with_outliers": both,
    }


def test_the_command_writes_its_table(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(study, "BODIES", {"poked": BODIES["poked"]})
    options = ["--quick", "--only", "with_outliers", "--only", "Scales", "--processes", "1"]
    assert main(["--out", str(tmp_path), *options]) == 0
    page = capsys.readouterr().out
    assert (tmp_path / "table.md").read_text() == page
    assert "| with_outliers | 1.000 |" in page
    assert "estimators/filters/kernels.py:" in page


def test_an_unknown_mechanism_is_one_line(tmp_path, capsys):
    assert main(["--out", str(tmp_path / "out"), "--only", "magic"]) == 2
    assert "--only: expected one of" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
