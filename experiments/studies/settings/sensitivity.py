"""What each setting is worth: the figures that it serves, at its default, at half and at twice of it.

    python -m experiments.studies.settings.sensitivity --out DIR               # every family; hours on two cores
    python -m experiments.studies.settings.sensitivity --out DIR --only marks  # one of them
    python -m experiments.studies.settings.sensitivity --page DIR              # rewrites docs/settings.md from it

Settings are fields of frozen records. The docstring of a record gives for each its meaning, its unit and its origin: a
source, the command that measured it, or a choice. Of a choice this study records what half and twice of it cost.
DIR/FAMILY.json keeps the figures of each variant; a study that was interrupted goes on where it stopped.
"""

from __future__ import annotations

import argparse
import inspect
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from experiments.engine.executor import RunsFailedError, finished
from experiments.engine.progress import run_bar
from experiments.engine.workers import Workers, add_worker_options, chosen_workers
from experiments.formats.outputs import write_whole
from experiments.studies.settings.families import FAMILIES, Family, Figures

PAGE = Path(__file__).parents[3] / "docs" / "settings.md"
ORIGINS = ("source", "measured", "choice")


@dataclass(frozen=True, slots=True)
class Setting:
    """One field of a settings record: its path in the record, meaning, unit, origin (one of ORIGINS) and default."""

    path: str
    meaning: str
    unit: str
    origin: str
    reason: str
    default: Any


def documented(record: type) -> dict[str, tuple[str, str, str, str]]:
    """Meaning, unit, origin and reason of each field by its name, from the docstring of a settings record.

    An entry reads `name: meaning [unit]; origin`, or `name: meaning; source: where from`, and may take several lines;
    several names share an entry with commas between them.
    """
    text = inspect.cleandoc(record.__doc__ or "")
    entries = re.split(r"\n(?=[a-z]\w*(?:, [a-z]\w*)*: )", "\n" + text)
    found = {}
    for entry in entries[1:]:
        names, _, rest = entry.split("\n\n")[0].partition(": ")
        flat = " ".join(rest.split())
        meaning, _, origin = flat.rpartition("; ")
        kind, _, reason = origin.partition(":")
        unit = re.search(r"\[([^\]]+)\]", meaning)
        for name in names.split(", "):
            found[name] = (meaning, unit[1] if unit else "", kind.strip(), reason.strip())
    return found


def settings_of(record: Any, prefix: str = "") -> Iterator[Setting]:
    """Every setting of a record and of the records in it, in their order."""
    known = documented(type(record))
    for field in fields(record):
        value = getattr(record, field.name)
        if is_dataclass(value) and not isinstance(value, type):
            yield from settings_of(value, f"{prefix}{field.name}.")
        else:
            yield Setting(f"{prefix}{field.name}", *known.get(field.name, ("", "", "", "")), value)


def changed(record: Any, path: str, value: Any) -> Any:
    """The record with one setting, named by its path, of another value."""
    first, _, rest = path.partition(".")
    return replace(record, **{first: changed(getattr(record, first), rest, value) if rest else value})


def variants(setting: Setting) -> dict[str, Any]:
    """Half and twice of a setting that is a number or some numbers; none of any other."""

    def times(value: Any, factor: float) -> Any:
        if isinstance(value, bool) or not isinstance(value, int | float):
            return None
        return max(1, round(value * factor)) if isinstance(value, int) else value * factor

    found = {}
    for name, factor in (("half", 0.5), ("twice", 2.0)):
        if isinstance(setting.default, tuple) and setting.default:
            scaled = tuple(times(value, factor) for value in setting.default)
            if None not in scaled:
                found[name] = scaled
        elif (value := times(setting.default, factor)) is not None and value != setting.default:
            found[name] = value
    return found


def figures_of(variant: tuple[str, str, Any]) -> Figures | str:
    """Figures of one variant (family, path, value), or why the record does not take it."""
    family, path, value = variant
    own = FAMILIES[family]
    try:
        return own.figures(changed(own.record, path, value) if path else own.record)
    except ValueError as error:
        return f"not allowed: {error}"


def study(
    family: str,
    own: Family,
    folder: Path,
    workers: Workers,
    *,
    advance: Callable[[float], None] = lambda _share: None,
) -> dict[str, Any]:
    """Figures of the defaults and of each choice at half and at twice; kept in the folder as they come."""
    path = folder / f"{family}.json"
    known: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    asked: dict[str, tuple[str, Any]] = {"default": ("", None)}
    for setting in settings_of(own.record):
        if setting.origin == "choice":
            asked |= {f"{setting.path} {name}": (setting.path, value) for name, value in variants(setting).items()}
    left = [name for name in asked if name not in known]
    failures = []
    for k, run in enumerate(finished(figures_of, [(family, *asked[name]) for name in left], workers), start=1):
        if run.failure is None:
            known[left[run.index]] = run.result
            write_whole(path, json.dumps(known, indent=1) + "\n")
        else:
            failures.append(f"{family}, {left[run.index]}: {run.failure}")
        advance(k / len(left))
    if failures:
        raise RunsFailedError("; ".join(failures))
    return {name: known[name] for name in asked}


def cost(default: Figures, other: Figures | str) -> str:
    """The figure that changes most, in per cent of the default; `-` where none does by half a per cent."""
    if isinstance(other, str):
        return other
    shares = {name: (other[name] - value) / abs(value) for name, value in default.items() if value}
    worst = max(shares, key=lambda name: abs(shares[name]), default="")
    if not worst or abs(shares[worst]) < 0.005:
        return "-"
    return f"{worst} {100.0 * shares[worst]:+.0f} %"


def page(folder: Path) -> str:
    """The text of docs/settings.md: every setting, and what half and twice of each choice cost."""
    lines = [
        "# Settings",
        "",
        "Every number that steers behaviour, by what it serves. Origin: a source, the command that measured it, or a",
        "choice; of a choice, the figure that changes most at half and at twice of it. Made by",
        "`python -m experiments.studies.settings.sensitivity`, on seeds that no study reports on.",
        "",
    ]
    for family, own in FAMILIES.items():
        path = folder / f"{family}.json"
        known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        default = known.get("default", {})
        lines += [f"## {family}", ""]
        if default:
            values = ", ".join(f"{name} {value:.4g}" for name, value in default.items())
            lines += [f"At the defaults: {values}.", ""]
        lines += ["| setting | default | meaning | origin | at half | at twice |", "| --- " * 6 + "|"]
        for one in settings_of(own.record):
            shown = f"{one.default:.4g}" if isinstance(one.default, float) else str(one.default)
            costs = [
                cost(default, known[f"{one.path} {name}"]) if default and f"{one.path} {name}" in known else ""
                for name in ("half", "twice")
            ]
            origin = one.origin + (f": {one.reason}" if one.reason else "")
            lines.append(f"| `{one.path}` | {shown} | {one.meaning} | {origin} | {costs[0]} | {costs[1]} |")
        lines.append("")
    return "\n".join(lines)


def main() -> None:
    """Run the study, or write its page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--out", type=Path)
    parser.add_argument("--only", default=",".join(FAMILIES))
    parser.add_argument("--page", type=Path)
    add_worker_options(parser)
    wanted = parser.parse_args()
    if wanted.out is not None:
        wanted.out.mkdir(parents=True, exist_ok=True)
        for family in wanted.only.split(","):
            with run_bar(family) as advance:
                study(family, FAMILIES[family], wanted.out, chosen_workers(wanted), advance=advance)
    if wanted.page is not None:
        write_whole(PAGE, page(wanted.page))


if __name__ == "__main__":
    main()
