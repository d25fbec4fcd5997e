"""Tables and lines that the subcommands print."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.table import Table

from experiments.plain import counted

if TYPE_CHECKING:
    from experiments.studies.demo import Figures
    from vision import Calibration

Row = Mapping[str, Any]

MARKS_SHOWN = 10
"""Largest number of marks in the table of `softaim track`; summary.json has all."""


def _table(title: str, *heads: str | list[str]) -> Table:
    """A table with these columns. Numbers are right-aligned; a head in a list makes a left-aligned column of words."""
    table = Table(title=title)
    for head in heads:
        table.add_column(*head, justify="left") if isinstance(head, list) else table.add_column(head, justify="right")
    return table


def track_table(figures: Mapping[str, Row]) -> Table:
    """One row for each method: errors if the truth is known, otherwise sigma and NIS; number of frames; speed."""
    known = any("mae_mm" in row for row in figures.values())
    columns = ERRORS if known else SIGMAS
    title = "Error of the hidden target" if known else "The hidden target; truth not known"
    table = _table(title, ["method"], *columns, "frames", "lost", "ms/frame")
    for method, row in figures.items():
        table.add_row(
            method,
            *(made(row) for made in columns.values()),
            str(row["frames"]),
            str(row["frames_lost"]),
            _number(row["ms_per_frame"], ".2f"),
        )
    return table


def _mean_sd(row: Row) -> str:
    return f"{_number(row.get('mae_mm'), '.2f')} ± {_number(row.get('sd_mm'), '.2f')}"


def _band(row: Row) -> str:
    return f"{row['nis_low']:.2f} to {row['nis_high']:.2f}" if "nis_low" in row else "–"


ERRORS: Mapping[str, Callable[[Row], str]] = {
    "mean ± SD [mm]": _mean_sd,
    "RMSE [mm]": lambda row: _number(row.get("rmse_mm"), ".2f"),
    "in 95 % region": lambda row: _number(row.get("coverage95"), ".1%"),
    "mean NEES": lambda row: _number(row.get("mean_nees"), ".2f"),
}
SIGMAS: Mapping[str, Callable[[Row], str]] = {
    "sigma per axis [mm]": lambda row: _number(row.get("sigma_mm"), ".2f"),
    "at most [mm]": lambda row: _number(row.get("sigma_most_mm"), ".2f"),
    "mean NIS": lambda row: _number(row.get("mean_nis"), ".2f"),
    "95 % band of NIS": _band,
}


def fit_lines(ours: Row) -> list[str]:
    """Lines from the filter's object in summary.json: statuses, verdict, sources of variance."""
    from experiments.pipeline.integrity import shares_words

    statuses = ", ".join(f"{n} {status}" for status, n in ours["frames_by_status"].items() if n)
    lines = [f"Frames: {statuses}; marks refused: {ours['marks_refused']}", sentence(ours["verdict"])]
    if ours.get("variance_shares"):
        lines.append(
            f"Advice also uses errors that the scene does not state: sigma {ours['sigma_advice_mm']:.2g} mm at end; "
            f"shares of this variance: {shares_words(ours['variance_shares'])}"
        )
    return lines


def withheld_table(ours: Row) -> Table:
    """One row for each mark: errors of its prediction by a filter without this mark, from summary.json."""
    heads = ("frames", "mean error [mm]", "mean NEES", "error / predicted")
    table = _table("Marks predicted as if hidden", ["mark"], *heads)
    for node, one in ours["check_marks"].items():
        nees = f"{one['mean_nees']:.2f}"
        table.add_row(node, str(one["frames"]), f"{one['mean_error_mm']:.2f}", nees, f"{one['ratio']:.2f}")
    return table


def sentence(words: str) -> str:
    """Words as a sentence, with a capital letter and a full stop."""
    return f"{words[0].upper()}{words[1:]}."


def marks_table(ours: Row) -> Table:
    """The marks found least often, with reasons, from the filter's object in summary.json."""
    table = _table("Marks", ["mark"], "found", "refused", "lost", ["most frequent reason"], "in frames")
    marks = ours["marks"]
    missed = sorted((node for node, row in marks.items() if row["found"] < 1.0), key=lambda node: marks[node]["found"])
    always = f"found in all frames: {len(marks) - len(missed)} of {counted(len(marks), 'mark')}"
    more = f"; {len(missed) - MARKS_SHOWN} more in summary.json" if len(missed) > MARKS_SHOWN else ""
    table.caption = always + more
    for node, row in ((node, marks[node]) for node in missed[:MARKS_SHOWN]):
        shares = [f"{row[key]:.1%}" for key in ("found", "refused", "lost")]
        reason = [row["reason"], f"{row['reason_share']:.1%}"] if row["reason"] else ["", ""]
        table.add_row(node if row["measured"] else f"{node} (scoring only)", *shares, *reason)
    return table


def taken_table(kinds: Sequence[Row], n_frames: int) -> Table:
    """One row for each hue: share of the picture that its keys select, its ratio to the marks' area, faulty frames."""
    heads = ("of the picture", "least", "most", "ratio to marks' area", "too few", "flooded")
    table = _table(f"Pixels that the keys select, in {counted(n_frames, 'frame')}", ["marks"], ["keys"], *heads)
    for row in kinds:
        shares = [f"{row[key]:.2%}" for key in ("share_median", "share_least", "share_most")]
        amiss = [f"{row[key]:.1%}" for key in ("frames_too_few", "frames_flooded")]
        table.add_row(", ".join(row["marks"]), row["keys"], *shares, f"{row['by_marks']:.2f}", *amiss)
    return table


def advice_line(counts: Mapping[str, int]) -> str:
    """Number of frames with each advice, in one line."""
    frames = sum(counts.values())
    return f"{counted(frames, 'frame')}: " + ", ".join(f"{name} {n}" for name, n in counts.items())


def reliability_line(figures: Mapping[str, float | int | None]) -> str | None:
    """Predicted and observed hit rates in one line; None if the truth is not known."""
    parts = []
    for name, key in (("all frames", ""), ("frames with GO", "go_")):
        predicted, observed, n = (figures[f"{key}{one}"] for one in ("predicted", "observed", "insertions"))
        if predicted is not None:
            parts.append(f"{name}: predicted {predicted:.1%}, observed {observed:.1%} ({n})")
    return f"Hits in {'; '.join(parts)}" if parts else None


def plan_table(report: Mapping[str, Any]) -> Table:
    """One row for each of the best paths in plan.json."""
    title = f"Paths to {report['target']['node']}: {report['allowed']} of {report['paths']} allowed"
    heads = ("", "entry [mm]", "depth [mm]", "angle", "hit", "clearance [mm]", "push on target [mm]")
    table = _table(title, *heads)
    for rank, path in enumerate([report["best"], *report["next_best"]], start=1):
        table.add_row(
            str(rank),
            ", ".join(f"{x:.1f}" for x in path["entry_mm"]),
            f"{path['depth_mm']:.1f}",
            f"{path['angle_deg']:.0f}°",
            f"{path['hit_probability']:.1%}",
            _number(path["clearance_mm"], ".1f"),
            ", ".join(f"{x:.1f}" for x in path["pushed_mm"]),
        )
    return table


def insertion_table(report: Mapping[str, Any]) -> Table:
    """One row for each policy in summary.json: hit rate with its interval, misses, time, insertions."""
    title = f"runs: {report['runs']}, a lesion of {report['radius_mm']:g} mm at {report['speed_mm_s']:g} mm/s"
    heads = ("hits", "95 % interval", "predicted", "miss [mm]", "time to a hit [s]", "insertions", "never arrived")
    table = _table(title, ["policy"], *heads)
    for policy, row in report.items():
        if isinstance(row, Mapping) and "hit_rate" in row:
            table.add_row(
                policy,
                f"{row['hit_rate']:.1%}",
                f"{row['hit_rate_low']:.1%} to {row['hit_rate_high']:.1%}",
                _number(row["predicted"], ".1%"),
                _number(row["miss_mm"], ".2f"),
                _number(row["seconds_to_hit"], ".2f"),
                f"{row['insertions']:.2f}",
                str(row["never"]),
            )
    return table


def insertion_lines(report: Mapping[str, Any]) -> list[str]:
    """Predicted and observed hit rates of `softaim advise` in the same simulations, from summary.json."""
    of, lines = report["advise"], []
    if not any(of["advice"].values()):
        return []
    for words, key in (("at any time", ""), ("on GO", "go_")):
        predicted, observed = of[f"{key}predicted"], of[f"{key}observed"]
        if predicted is None:
            lines.append(f"Advice {words}: no insertions")
            continue
        off, sd = 100.0 * of[f"{key}difference"], of[f"{key}difference_sd"]
        spread = "" if sd is None else f" ± {196.0 * sd:.1f}"
        lines.append(
            f"Advice {words}: {counted(of[f'{key}insertions'], 'insertion')}, predicted {predicted:.1%}, "
            f"observed {observed:.1%} ({of[f'{key}observed_low']:.1%} to {of[f'{key}observed_high']:.1%}), "
            f"difference {off:+z.1f}{spread} points"
        )
    return lines


def demo_table(figures: Figures) -> Table:
    """Mean absolute error ± SD for each method and scenario, with the paper's figures."""
    from experiments.studies.demo import PAPER_MM, heads

    table = _table("Mean absolute error ± SD of the hidden mass [mm]", ["method"], *heads())
    methods = list(next(iter(figures.values())))
    table.add_row(
        "as published (1.09 s per frame, marks accurate to 4.14 mm)",
        *(f"{m:.2f} ± {s:.2f}" for m, s in PAPER_MM.values()),
    )
    for method in methods:
        label = f"{method} (the paper's method, on these frames)" if method == "open-loop" else method
        table.add_row(label, *(_mean_sd(rows[method]) for rows in figures.values()))
    table.add_row(
        "filter: truth inside its 95 % region; good: 90 to 99.5 %",
        *(_number(rows["filter"].get("coverage95"), ".1%") for rows in figures.values()),
    )
    return table


def sweep_table(cells: Sequence[Sequence[str]]) -> Table:
    """One row for each combination of parameters and method; the first row of cells has the heads."""
    broken = [head.replace(".", ".\n") for head in cells[0]]  # keys of a grid are long
    table = _table("Error of the hidden target, over runs", *([one] if one == "method" else one for one in broken))
    for row in cells[1:]:
        table.add_row(*row)
    return table


def faults_table(cells: Sequence[Sequence[str]]) -> Table:
    """One row for each fault."""
    from experiments.studies.faults.study import HEADS

    heads = [[head] if head in ("fault", "shown") else head for head in HEADS]
    table = _table("Faults: the slowest of all seeds", *heads)
    for row in cells:
        table.add_row(*row)
    return table


def bench_table(report: Mapping[str, Mapping[str, float] | Sequence[Mapping[str, float]]]) -> Table:
    """One row for each figure of a benchmark; several for each mesh size."""
    table = _table("Benchmarks (medians of one run)", ["benchmark"], ["figure"], "value")
    for name, figures in report.items():
        if isinstance(figures, Mapping):
            for key, value in figures.items():
                table.add_row(name, key, f"{value:.3g}")
            continue
        for size in figures:
            for key in ("ms_per_estimate", "prepare_s", "memory_mb"):
                table.add_row(name, f"{key}, {size['nodes']:.0f} nodes", f"{size[key]:.3g}")
    return table


def constants_table(report: Mapping[str, Any]) -> Table:
    """One row for each identified constant, with its standard error; the caption counts undetermined combinations."""
    table = _table("Constants found", ["constant"], "value [SI]", "standard error", "change")
    for row in report["constants"]:
        change = "kept" if row["kept"] else f"{row['change']:+z.1%}"
        table.add_row(row["name"], f"{row['value']:.4g}", f"{row['standard_error']:.1%}", change)
    n, n_all = len(report["undetermined_combinations"]), len(report["constants"])
    known = "all" if not n else "none" if n == n_all else f"{n_all - n} of {n_all} independent combinations"
    kept = f"; {n} keep their prior uncertainty (--json lists them)" if 0 < n < n_all else ""
    table.caption = f"{counted(report['passes'], 'pass', 'passes')}. The recording determines {known} of them{kept}."
    return table


def levels_table(report: Mapping[str, Any]) -> Table:
    """One row for each noise level, with its standard error."""
    units = {"white": "m/s²/√Hz", "poke": "m/s²", "marks": "times the stated sd", "strain": "of the extent"}
    table = _table("Noise levels found", ["level"], "value", ["unit"], "standard error")
    for name, row in report["levels"].items():
        table.add_row(name, f"{row['value']:.3g}", units[name], f"{row['relative_standard_error']:.0%}")
    gained = report["log_likelihood"] - report["log_likelihood_before"]
    table.caption = f"The new levels change the log likelihood of the recording by {gained:+z.1f}."
    return table


def calibration_table(done: Calibration) -> Table:
    """One row for each constant of the lens, with its standard error."""
    title = f"Camera {done.name}, {done.size_px[0]}x{done.size_px[1]} px"
    table = _table(title, ["constant"], "value", "standard error")
    values = [*done.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], *done.distortion]
    names = ("fx [px]", "fy [px]", "cx [px]", "cy [px]", "k1", "k2", "p1", "p2", "k3")
    for name, value, sd in zip(names, values, [*done.matrix_sd, *done.distortion_sd], strict=True):
        form = ".2f" if name.endswith("[px]") else ".5f"
        table.add_row(name, format(value, form), format(sd, form))
    return table


def calibration_lines(done: Calibration) -> list[str]:
    """Lines with the residuals, omitted pictures, and the size of a pixel on the plane."""
    across, down = done.mm_per_px
    out = f"{len(done.images_left_out)} left out{':' if done.images_left_out else ''}"
    return [
        f"{len(done.images_used)} pictures used, rms {done.reprojection_rms_px:.3f} px; {out}",
        *(f"  {line}" for line in done.images_left_out),
        f"World coordinates are those of the board in {done.plane_image}; --plane chooses another picture",
        f"In that plane a pixel at the picture's centre covers {across:.3f} x {down:.3f} mm",
    ]


def registration_table(report: Mapping[str, Any]) -> Table:
    """One row for each point: its residual, and its distance from the position that the other points predict."""
    table = _table(
        f"Registration by {counted(len(report['points']), 'point')}", ["point"], "residual", "left out", "expected"
    )
    for row in report["points"]:
        table.add_row(
            row["name"], *(_number(row[key], ".2f") for key in ("residual_mm", "left_out_mm", "left_out_expected_mm"))
        )
    table.caption = "Distances in mm; left out: from the position that the other points predict."
    return table


def _number(value: float | int | None, form: str) -> str:
    return "–" if value is None else format(value, form)
