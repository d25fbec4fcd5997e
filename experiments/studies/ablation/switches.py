"""Mechanisms of the filter that can be turned off, each with the code that would go with it: `switches.csv`.

places: names of what would go whole, with a number that of which so many lines would go
kinds: of bodies on which it acts, soft, stiff (those whose motion is linearised), checked (with the option check)
"""

from __future__ import annotations

import csv
import inspect
import pkgutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from estimators import AssociatedEstimate, FilterSettings
from estimators.filters.measurement import Outliers
from estimators.filters.opinions import Scales
from estimators.tissue.gate import Gated
from estimators.tissue.update import outliers_of

ROOT = Path(__file__).parents[3]
WHOLE, TOGETHER = "whole filter", " + "

Changes = Mapping[str, Callable[[Any], Any]]
"""By name, what replaces an attribute, given what it was."""


@dataclass(frozen=True, slots=True)
class Switch:
    """A row of the table: name of a mechanism, kinds of bodies, what it does, code that would go."""

    name: str
    kinds: str
    what: str
    places: str

    @property
    def found(self) -> list[tuple[str, int, int, int]]:
        """File, first and last line of each place, and how many of them would go."""
        return [_lines(*place.partition(" ")[::2]) for place in self.places.split(", ")]

    @property
    def lines(self) -> int:
        """Lines of code that would go."""
        return sum(n for *_, n in self.found)


def _lines(name: str, part: str) -> tuple[str, int, int, int]:
    place, _, attribute = _full(name).rpartition(".")
    value: Any = inspect.getattr_static(pkgutil.resolve_name(place), attribute)
    inner: Any = value.fget if isinstance(value, property) else getattr(value, "py_func", value)
    value = inspect.unwrap(inner)
    source, first = inspect.getsourcelines(value)
    first = max(first, 1)
    path = Path(inspect.getfile(value)).relative_to(ROOT)
    return str(path), first, first + len(source) - 1, int(part or len(source))


def _full(name: str) -> str:
    return name if name.startswith("dynamics.") else f"estimators.{name}"


@contextmanager
def turned_off(names: str) -> Iterator[None]:
    """The filter without the mechanisms of these names, joined by `TOGETHER`; nothing is off by `WHOLE`."""
    with ExitStack() as stack:
        for name in names.split(TOGETHER):
            for place, change in OFF[name].items():
                owner, _, attribute = _full(place).rpartition(".")
                target = pkgutil.resolve_name(owner)
                stack.enter_context(patch.object(target, attribute, change(inspect.getattr_static(target, attribute))))
        yield


def _settings(**values: Any) -> Changes:
    """Every filter is made with these settings, whatever is asked for."""

    def changed(init: Any) -> Any:
        def made(self: Any, network: Any, target: Any, marked: Any, settings: Any = None, **more: Any) -> None:
            init(self, network, target, marked, replace(settings or FilterSettings(), **values), **more)

        return made

    return {"tissue.filter.TissueFilter.__init__": changed}


def _less(keyword: str) -> Callable[[Any], Any]:
    """A function called without one of its keywords."""
    return lambda old: lambda *given, **more: old(*given, **{k: v for k, v in more.items() if k != keyword})


def _value(place: str, value: Any) -> Changes:
    return {place: lambda _: value}


def _property(place: str, value: Any) -> Changes:
    return {place: lambda _: property(lambda _self: value)}


def _without_simulation(of_target: Any) -> Any:
    def alone(self: Any, *given: Any) -> Any:
        shown, self.shown = self.shown, replace(self.shown, led=None)
        try:
            return of_target(self, *given)
        finally:
            self.shown = shown

    return alone


def _always_outliers(network: Any, rest: Any, settings: FilterSettings) -> Outliers | None:
    if settings.led is not None or settings.one_of:
        return outliers_of(network, rest, settings)
    return Outliers(network.dim, float(np.ptp(rest, axis=0).max()) ** 2, float(np.log(settings.outlier_odds)))


def _by_mixture(mixture: Any, place: slice, shared: Any, _settings: Any) -> Any:
    columns = mixture.mean_columns[place]
    own = columns if shared is None else columns + shared
    return mixture.x[place].copy(), mixture.P[place, place] - columns @ columns.T + own @ own.T


def _all_accepted(marks: Any, *_: Any, **__: Any) -> Gated:
    return Gated(list(marks), (), {}, 0.0)


SETTINGS, ERROR = "tissue.settings.FilterSettings", "tissue.model_error.ModelError"

OFF: Mapping[str, Changes] = {
    WHOLE: {},
    "restart inflation": _settings(inflation=1.0),
    "restarts": _value("tissue.filter.after_divergence", lambda *_, **__: None),
    "reach of a start": _value("tissue.start.within_reach", lambda cov, _network: 0.5 * (cov + cov.T)),
    "reach of the target": _value("process.target.TargetMap.within_reach", lambda _self, covs: covs),
    "Shown.inflation": {
        ERROR + ".learn": lambda old: lambda self, marks, mixture, nis: old(self, marks, mixture, nis and 0.0),
        **_value(ERROR + ".start", lambda *_: None),
    },
    "refuted": _value(ERROR + ".status", lambda _self, of_health, *_: of_health),
    "memory by swings": _settings(remember_swings=0.0),
    "Scales": _value("tissue.model_error.likeliest_scales", lambda *_, **__: Scales()),
    "led_inflation": _settings(led_inflation=np.inf),
    "simulation": {ERROR + ".of_target": _without_simulation},
    "field": _value(ERROR + ".of_field", lambda *_: (np.zeros(0), np.zeros((0, 0)))),
    "field's trust": {"tissue.prediction.corrected_each": _less("trust")},
    "bound beside the field": _value("filters.gaussians.OF_TWO", 1e12),
    "evened_each": _value("tissue.prediction.evened_each", lambda _odds, beliefs, *_: beliefs),
    "all opinions": _value("tissue.model_error.is_linearised", lambda _: False),
    "NoiseLevel": _settings(white_bounds=(1.0, 1.0)),
    "least_white": _settings(least_white=(0.0, 0.0)),
    "hand_strain": _settings(hand_strain=0.0),
    "hidden_share": _settings(hidden_share=0.0),
    "strain": {
        "tissue.model.strain_uncertainty": lambda old: lambda *a: replace(s := old(*a), directions=s.directions[:0])
    },
    "softened links": _value("tissue.model.as_stiff_as_known", lambda network, _sd: network),
    "led mode": _property(SETTINGS + ".may_be_led", False),
    "struck mode": {
        **_property(SETTINGS + ".strikes", False),
        **_value("tissue.filter.outliers_of", _always_outliers),
    },
    "MANY_BLOWS": _value("tissue.health.MANY_BLOWS", np.inf),
    "calm": _settings(calm_s=1.5),
    "ModeChain.begun": _value("tissue.prediction.onset_of", lambda *_: None),
    "iterated update": _value("process.linear_motion.PASSES", 1),
    "narrowed points": _value("process.process_model.TissueModel.turned", lambda _, p: np.zeros(len(p), dtype=bool)),
    "ADDED_SHARE": _value("filters.mixture.ADDED_SHARE", 0.0),
    "CommonErrors": _value("filters.measurement.CommonErrors.told", lambda self, *_: self),
    "LeaveOneOut.scale": _property("consistency.leave_one_out.LeaveOneOut.scale", 1.0),
    "marks_bounds": _settings(marks_bounds=(1.0, 1.0)),
    "AssociationFilter": _value(
        "association.identity.AssociationFilter.update",
        lambda self, marks: AssociatedEstimate(self.tissue.update(marks), tuple(marks)),
    ),
    "with_outliers": _value("tissue.filter.outliers_of", lambda *_: None),
    "gate_marks": _value("tissue.filter.gate_marks", _all_accepted),
    "gate_start": _value("tissue.filter.gate_start", _all_accepted),
    "confirmed": _value("tissue.gate.confirmed", lambda *_: False),
    "CROWD": _value("tissue.gate.CROWD", 10**9),
    "widest mode": _value("tissue.filter.expected_place", _by_mixture),
    "model_only": _settings(model_only_share=np.inf),
}

with (Path(__file__).parent / "switches.csv").open(encoding="utf-8") as _file:
    SWITCHES: Mapping[str, Switch] = {row["name"]: Switch(**row) for row in csv.DictReader(_file, delimiter=";")}
