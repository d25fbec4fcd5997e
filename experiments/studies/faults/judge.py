"""One run with one fault: what was shown of it, how fast, and whether GO was shown on an estimate that was wrong."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from estimators import Advice, AdviceSettings, Insertion, Lesion, Needle, Status, TargetEstimate
from experiments.arrays import Floats
from experiments.formats.needle_file import NeedlePlan
from experiments.formats.scene.scene import Scene
from experiments.pipeline.line import Line
from experiments.pipeline.live.following import follow
from experiments.pipeline.live.session import ESTIMATES, Session
from experiments.pipeline.live.shown import Shown
from experiments.studies.faults.catalogue import ONSET_S, Fault
from experiments.studies.faults.world import (
    BEGAN_S,
    INTERVAL_S,
    Arrival,
    Motion,
    ScriptedFrames,
    drawn,
    moved,
    scenario_of,
    scene_in_view,
)

DURATION_S = 12.0
ARRIVES_S = 0.5 * INTERVAL_S + 0.005
"""From exposure to arrival [s]: half a frame, and reading it out."""
WRONG = 0.999
"""An estimate is wrong where the truth lies outside of its region of this probability, and by more than `LEAST_M`."""
LEAST_M = 1e-3
"""A needle does not mind less [m]; chosen."""
STALE_S = 0.2
"""Age of what is shown from which on it must not be GO [s]: asked for."""
LESION_M = 0.012
"""Radius of the lesion [m]: so large that without a fault nearly always GO is shown, and nothing hides behind WAIT."""
STEADY_S = 0.5
"""So long all has to be well again to call it recovered [s]; chosen."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """What was shown at one time of the script [s] from the first exposure on.

    age_s: of the newest frame that was used; wrong: whether the truth was outside of the estimate
    sigma_m: of the target; why: the reason that was shown, empty for none
    """

    time_s: float
    age_s: float
    status: Status
    advice: Advice | None
    why: str
    sigma_m: float
    wrong: bool
    well: bool


@dataclass(frozen=True, slots=True)
class Judged:
    """What came of a fault in one run.

    noticed_ms: after its onset; None where nothing was shown of it
    covered: whether no estimate was wrong from `within_s` on until the fault was over and noticed to be
    shown: the words that were shown most while it lasted
    recovered_ms: after its end, or after its onset where it stays; None where it did not until the run's end
    sigma_before_mm, sigma_most_mm: spread of the target before, and the largest while it lasted
    go_shown_while_faulty: moments at which GO was shown on an estimate that was wrong, or older than STALE_S, from
        `within_s` after the onset on; go: all at which it was shown, from the onset on
    """

    fault: str
    seed: int
    noticed_ms: float | None
    covered: bool
    shown: str
    recovered_ms: float | None
    sigma_before_mm: float
    sigma_most_mm: float
    go_shown_while_faulty: int
    go: int


class Watching:
    """A `Publisher` that keeps what was shown. State: the moments."""

    def __init__(self, frames: ScriptedFrames, motion: Motion, target: int) -> None:
        self._frames, self._motion, self._target = frames, motion, target
        self.moments: list[Moment] = []
        self._used_s = -np.inf

    def publish(self, shown: Shown, line: Line) -> None:
        """Keep what is known now."""
        if shown.step is not None:
            self._used_s = shown.at_s
        now_s = self._frames.now_s
        guidance, estimate = shown.guidance, shown.estimate
        truth = self._motion.at(estimate.time_s - BEGAN_S)[self._target]
        measured = len(line.scene.measured_nodes)
        lacking = shown.step is not None and (estimate.marks_used < measured or bool(shown.step.refused))
        why = shown.fault or ("marks lost or refused" if lacking else "")
        cov = estimate.cov
        self.moments.append(
            Moment(
                now_s - BEGAN_S,
                now_s - self._used_s,
                estimate.status,
                None if guidance is None else guidance.advice,
                why,
                np.inf if cov is None else float(np.sqrt(np.linalg.eigvalsh(cov)[-1])),
                is_wrong(estimate, truth),
                well=estimate.status is Status.TRACKING and not why,
            )
        )


def is_wrong(estimate: TargetEstimate, truth_m: Floats) -> bool:
    """Whether the truth [m], (dim,), lies outside of the estimate's region of `WRONG`, and not only by a little."""
    if estimate.cov is None or not np.isfinite(estimate.mean).all() or not np.isfinite(estimate.cov).all():
        return True
    off = truth_m - estimate.mean
    if float(np.linalg.norm(off)) <= LEAST_M:
        return False
    return bool(off @ np.linalg.solve(estimate.cov, off) > chi2.ppf(WRONG, len(off)))


def plan_of(scene: Scene) -> NeedlePlan:
    """A needle from above that is almost there: whatever the breath, it is advised on."""
    node = scene.network.positions[scene.network.index(scene.target.node)]
    entry = node + np.array([0.0, 0.03])
    return NeedlePlan(
        insertion=Insertion(entry=entry, axis=node - entry, speed_m_s=0.5),
        lesion=Lesion.ball(LESION_M, scene.network.dim),
        needle=Needle(),
        settings=AdviceSettings(go=0.5, worth=1.0),
    )


def judged(fault: Fault, seed: int, folder: Path) -> Judged:
    """Run a fault once; folder: one that exists, for the tables of the run."""
    scenario = scenario_of(seed, DURATION_S)
    scene = scene_in_view(scenario)
    motion = moved(scenario, scene.network, fault.becomes, ONSET_S)
    frames = ScriptedFrames(_arrivals(fault, scene, motion, seed))
    believed = fault.believed(scene)
    watching = Watching(frames, motion, scene.network.index(scene.target.node))
    clock = partial(getattr, frames, "now_s")
    session = Session(
        believed,
        folder / ESTIMATES,
        lambda _text: None,
        needle=plan_of(believed),
        publisher=watching,
        clock=clock,
    )
    follow(session, frames, DURATION_S, clock)
    session.close()
    return _verdict(fault, seed, watching.moments)


def _arrivals(fault: Fault, scene: Scene, motion: Motion, seed: int) -> list[Arrival]:
    rng = np.random.default_rng([seed, 7])
    arrivals = []
    for k in range(int(DURATION_S / INTERVAL_S)):
        time_s = k * INTERVAL_S
        places, hidden = motion.at(time_s), tuple[str, ...]()
        acts, since_s = fault.acts(time_s), time_s - ONSET_S
        if acts:
            places, hidden = fault.places(places, since_s, scene), fault.covered
        image = drawn(scene, places, rng, hidden=hidden)
        arrivals.append(Arrival(BEGAN_S + time_s + ARRIVES_S, fault.picture(image, since_s, rng) if acts else image))
    return fault.arrivals(arrivals, rng)


def _verdict(fault: Fault, seed: int, moments: list[Moment]) -> Judged:
    before = [one for one in moments if ONSET_S - 1.0 <= one.time_s < ONSET_S]
    during = [one for one in moments if ONSET_S <= one.time_s < min(fault.ends_s, DURATION_S)]
    after = [one for one in moments if one.time_s >= ONSET_S]
    noticed_s = next((one.time_s for one in after if not one.well), None)
    recovered_s = _recovered(after, ONSET_S if np.isinf(fault.lasts_s) else fault.ends_s, noticed_s)
    over_s = np.inf if recovered_s is None else recovered_s
    judged_from = [one for one in after if one.time_s >= ONSET_S + fault.within_s and one.time_s < over_s]
    stays = np.isinf(fault.lasts_s)
    faulty = [one for one in after if one.time_s >= ONSET_S + fault.within_s] if stays else judged_from
    go = [one for one in after if one.advice is Advice.GO]
    words = Counter(f"{one.status}: {one.why}" if one.why else str(one.status) for one in during if not one.well)
    return Judged(
        fault.name,
        seed,
        None if noticed_s is None else 1e3 * (noticed_s - ONSET_S),
        not any(one.wrong for one in faulty),
        words.most_common(1)[0][0] if words else "",
        None if recovered_s is None else 1e3 * (recovered_s - (ONSET_S if stays else fault.ends_s)),
        1e3 * float(np.median([one.sigma_m for one in before])),
        1e3 * max((one.sigma_m for one in during), default=0.0),
        sum(one.advice is Advice.GO and (one.wrong or one.age_s > STALE_S) for one in faulty),
        len(go),
    )


def _recovered(after: list[Moment], over_s: float, noticed_s: float | None) -> float | None:
    """When all is well for good after the fault was over, or was noticed where it stays [s]."""
    if noticed_s is None:
        return over_s
    began_s: float | None = None
    for one in after:
        if one.time_s < max(over_s, noticed_s) or not one.well or one.wrong:
            began_s = None
        elif began_s is None:
            began_s = one.time_s
        elif one.time_s - began_s >= STEADY_S:
            return began_s
    return None
