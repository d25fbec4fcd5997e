"""Tables and lines that the subcommands print."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.table import Table

from experiments.plain import counted

if TYPE_CHECKING:
    from experiments.studies.demo import Figures
    from vision import Calibration

Row = Mapping[str, Any]

MARKS_SHOWN = 10
"""Largest number of marks in the table of `softaim track`; summary.json has all."""


def _table(
    title: str, heads: Sequence[str | Sequence[str]], rows: Iterable[Sequence[str]], caption: str | None = None
) -> Table:
    """A table of these rows. If a heading is a list of one text, its column is left-aligned, else right-aligned."""
    table = Table(title=title, caption=caption)
    for head in heads:
        table.add_column(head, justify="right") if isinstance(head, str) else table.add_column(*head, justify="left")
    for row in rows:
        table.add_row(*row)
    return table


def track_table(figures: Mapping[str, Row]) -> Table:
    """A row for each method. If the truth is known, rows have errors, otherwise standard deviations and NIS."""
    known = any("mae_mm" in row for row in figures.values())
    columns = ERRORS if known else SIGMAS
    title = "Error of the hidden target" if known else "The hidden target; truth not known"
    rows = []
    for method, row in figures.items():
        counts = [str(row["frames"]), str(row["frames_lost"]), _number(row["ms_per_frame"], ".2f")]
        rows.append([method, *(made(row) for made in columns.values()), *counts])
    return _table(title, [["method"], *columns, "frames", "lost", "ms/frame"], rows)


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
    """Lines: frame counts, verdict on the filter, causes of the variance; ours: the filter's part of summary.json."""
    from experiments.pipeline.integrity import shares_words

    statuses = ", ".join(f"{n} {status}" for status, n in ours["frames_by_status"].items() if n)
    refused = f"marks refused: {ours['marks_refused']}"
    refused += f", fixes refused: {ours['fixes_refused']}" if ours.get("fixes_refused") else ""
    lines = [f"Frames: {statuses}; {refused}", sentence(ours["verdict"])]
    if ours.get("variance_shares"):
        lines.append(
            f"Advice also uses errors that the scene does not state: sigma {ours['sigma_advice_mm']:.2g} mm at end; "
            f"shares of this variance: {shares_words(ours['variance_shares'])}"
        )
    return lines


def withheld_table(ours: Row) -> Table:
    """A row for each mark: errors if it is predicted from the other marks; ours: the filter's part of summary.json."""
    heads = [["mark"], "frames", "mean error [mm]", "mean NEES", "error / predicted"]
    rows = [
        [node, str(one["frames"]), *(f"{one[key]:.2f}" for key in ("mean_error_mm", "mean_nees", "ratio"))]
        for node, one in ours["check_marks"].items()
    ]
    return _table("Marks predicted as if hidden", heads, rows)


def sentence(words: str) -> str:
    """The words with a capital letter and a full stop."""
    return f"{words[0].upper()}{words[1:]}."


def marks_table(ours: Row) -> Table:
    """A row for each of the marks missed most often, with the main reason; ours: the filter's part of summary.json."""
    marks, rows = ours["marks"], []
    missed = sorted((node for node, row in marks.items() if row["found"] < 1.0), key=lambda node: marks[node]["found"])
    always = f"found in all frames: {len(marks) - len(missed)} of {counted(len(marks), 'mark')}"
    more = f"; {len(missed) - MARKS_SHOWN} more in summary.json" if len(missed) > MARKS_SHOWN else ""
    for node, row in ((node, marks[node]) for node in missed[:MARKS_SHOWN]):
        shares = [f"{row[key]:.1%}" for key in ("found", "refused", "lost")]
        reason = [row["reason"], f"{row['reason_share']:.1%}"] if row["reason"] else ["", ""]
        rows.append([node if row["measured"] else f"{node} (scoring only)", *shares, *reason])
    heads = [["mark"], "found", "refused", "lost", ["most frequent reason"], "in frames"]
    return _table("Marks", heads, rows, always + more)


def taken_table(kinds: Sequence[Row], n_frames: int) -> Table:
    """A row for each hue: its share of the picture; shares of frames in which its area is too small and too large."""
    heads = [["marks"], ["keys"], "median", "least", "largest", "ratio to marks' area", "too few in", "too many in"]
    rows = []
    for row in kinds:
        shares = [f"{row[key]:.2%}" for key in ("share_median", "share_least", "share_most")]
        amiss = [f"{row[key]:.1%}" for key in ("frames_too_few", "frames_flooded")]
        rows.append([", ".join(row["marks"]), row["keys"], *shares, f"{row['by_marks']:.2f}", *amiss])
    return _table(f"Share of the picture that the keys select, in {counted(n_frames, 'frame')}", heads, rows)


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
    """A row for each of the best paths; report: the content of plan.json."""
    title = f"Paths to {report['target']['node']}: {report['allowed']} of {report['paths']} allowed"
    heads = ("", "entry [mm]", "depth [mm]", "angle", "hit", "clearance [mm]", "push on target [mm]")
    rows = [
        [
            str(rank),
            ", ".join(f"{x:.1f}" for x in path["entry_mm"]),
            f"{path['depth_mm']:.1f}",
            f"{path['angle_deg']:.0f}°",
            f"{path['hit_probability']:.1%}",
            _number(path["clearance_mm"], ".1f"),
            ", ".join(f"{x:.1f}" for x in path["pushed_mm"]),
        ]
        for rank, path in enumerate([report["best"], *report["next_best"]], start=1)
    ]
    return _table(title, heads, rows)


def insertion_table(report: Mapping[str, Any]) -> Table:
    """A row for each policy; report: the content of summary.json."""
    title = f"runs: {report['runs']}, a lesion of {report['radius_mm']:g} mm at {report['speed_mm_s']:g} mm/s"
    heads = ("hits", "95 % interval", "predicted", "miss [mm]", "time to a hit [s]", "insertions", "never arrived")
    rows = [
        [
            policy,
            f"{row['hit_rate']:.1%}",
            f"{row['hit_rate_low']:.1%} to {row['hit_rate_high']:.1%}",
            _number(row["predicted"], ".1%"),
            _number(row["miss_mm"], ".2f"),
            _number(row["seconds_to_hit"], ".2f"),
            f"{row['insertions']:.2f}",
            str(row["never"]),
        ]
        for policy, row in report.items()
        if isinstance(row, Mapping) and "hit_rate" in row
    ]
    return _table(title, [["policy"], *heads], rows)


def insertion_lines(report: Mapping[str, Any]) -> list[str]:
    """Lines that compare predicted with observed hit rates of the advice; report: the content of summary.json."""
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
    """Mean absolute error ± SD in each scenario: a row with the published figures, and a row for each method."""
    from experiments.studies.demo import PAPER_MM, heads

    published = (f"{m:.2f} ± {s:.2f}" for m, s in PAPER_MM.values())
    rows = [["as published (1.09 s per frame, marks accurate to 4.14 mm)", *published]]
    for method in next(iter(figures.values())):
        label = f"{method} (the paper's method, on these frames)" if method == "open-loop" else method
        rows.append([label, *(_mean_sd(of[method]) for of in figures.values())])
    covered = (_number(of["filter"].get("coverage95"), ".1%") for of in figures.values())
    rows.append(["filter: truth inside its 95 % region; good: 90 to 99.5 %", *covered])
    return _table("Mean absolute error ± SD of the hidden mass [mm]", [["method"], *heads()], rows)


def sweep_table(cells: Sequence[Sequence[str]]) -> Table:
    """A row for each method with each combination of parameters; the first row of `cells` has the headings."""
    broken = [head.replace(".", ".\n") for head in cells[0]]  # keys of a grid are long
    heads = [[one] if one == "method" else one for one in broken]
    return _table("Error of the hidden target, over runs", heads, cells[1:])


def faults_table(cells: Sequence[Sequence[str]]) -> Table:
    """A row for each fault."""
    from experiments.studies.faults.study import HEADS

    heads = [[head] if head in ("fault", "shown") else head for head in HEADS]
    return _table("Faults: the slowest of all seeds", heads, cells)


def bench_table(report: Mapping[str, Mapping[str, float] | Sequence[Mapping[str, float]]]) -> Table:
    """A row for each figure of each benchmark. The benchmark `scaling` has rows for each mesh."""
    rows = []
    for name, figures in report.items():
        if isinstance(figures, Mapping):
            rows += [[name, key, f"{value:.3g}"] for key, value in figures.items()]
            continue
        for size in figures:
            keys = ("ms_per_estimate", "prepare_s", "memory_mb")
            rows += [[name, f"{key}, {size['nodes']:.0f} nodes", f"{size[key]:.3g}"] for key in keys]
    return _table("Benchmarks (medians of one run)", [["benchmark"], ["figure"], "value"], rows)


def constants_table(report: Mapping[str, Any]) -> Table:
    """A row for each identified constant."""
    rows = []
    for row in report["constants"]:
        change = "kept" if row["kept"] else f"{row['change']:+z.1%}"
        rows.append([row["name"], f"{row['value']:.4g}", f"{row['standard_error']:.1%}", change])
    n, n_all = len(report["undetermined_combinations"]), len(report["constants"])
    known = "all" if not n else "none" if n == n_all else f"{n_all - n} of {n_all} independent combinations"
    kept = f"; {n} keep their prior uncertainty (--json lists them)" if 0 < n < n_all else ""
    caption = f"{counted(report['passes'], 'pass', 'passes')}. The recording determines {known} of them{kept}."
    return _table("Constants found", [["constant"], "value [SI]", "standard error", "change"], rows, caption)


def levels_table(report: Mapping[str, Any]) -> Table:
    """A row for each compared level: its log likelihood, relative to the largest one, and which level was chosen."""
    most = max(row["log_likelihood"] for row in report["levels"])
    rows = [
        [f"{row['strain']:g}", f"{row['log_likelihood'] - most:z.1f}", "chosen" * (row["strain"] == report["strain"])]
        for row in report["levels"]
    ]
    before = f"{report['log_likelihood_before'] - most:+z.1f}"
    caption = (
        "Log likelihood of each mark given distant marks, relative to the largest; chosen: the largest level that the "
        f"marks do not reject. Scene as given (without strain, its level is estimated in each frame): {before}."
    )
    return _table("Levels compared", ["strain", "log likelihood", [""]], rows, caption)


def calibration_table(done: Calibration) -> Table:
    """A row for each constant of the lens, with its standard error."""
    title = f"Camera {done.name}, {done.size_px[0]}x{done.size_px[1]} px"
    values, sds = [*done.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], *done.distortion], [*done.matrix_sd, *done.distortion_sd]
    names = ("fx [px]", "fy [px]", "cx [px]", "cy [px]", "k1", "k2", "p1", "p2", "k3")
    forms = [".2f" if name.endswith("[px]") else ".5f" for name in names]
    columns = [names, *(map(format, column, forms) for column in (values, sds))]
    return _table(title, [["constant"], "value", "standard error"], list(zip(*columns, strict=True)))


def calibration_lines(done: Calibration) -> list[str]:
    """Lines with the rms residual, the unused pictures, and the size [mm] that a pixel covers on the plane."""
    across, down = done.mm_per_px
    out = f"{len(done.images_left_out)} left out{':' if done.images_left_out else ''}"
    return [
        f"{len(done.images_used)} pictures used, rms {done.reprojection_rms_px:.3f} px; {out}",
        *(f"  {line}" for line in done.images_left_out),
        f"World coordinates are those of the board in {done.plane_image}; --plane chooses another picture",
        f"In that plane a pixel at the picture's centre covers {across:.3f} x {down:.3f} mm",
    ]


def registration_table(report: Mapping[str, Any]) -> Table:
    """A row for each point: residual of the fit; error if the other points predict the point; expected error."""
    keys = ("residual_mm", "left_out_mm", "left_out_expected_mm")
    rows = [[row["name"], *(_number(row[key], ".2f") for key in keys)] for row in report["points"]]
    title, heads = f"Registration by {counted(len(rows), 'point')}", [["point"], "residual", "left out", "expected"]
    return _table(title, heads, rows, "Distances in mm; left out: from the position that the other points predict.")


def lines_table(lines: Iterable[tuple[str, str]]) -> Table:
    """Pairs of texts in two columns."""
    table = Table.grid(padding=(0, 2))
    for line in lines:
        table.add_row(*line)
    return table


def _number(value: float | int | None, form: str) -> str:
    return "–" if value is None else format(value, form)
