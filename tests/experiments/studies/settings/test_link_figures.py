"""Figures of identification by the linear filter follow its constants."""

from dataclasses import replace

import numpy as np
import pytest

from estimators import IdentificationError
from estimators.identification.constants import START_SPREAD
from estimators.identification.filter_pass import is_linear
from experiments.studies.settings import link_figures as study
from experiments.studies.settings.constants import constants_in_place
from experiments.studies.settings.link_figures import (
    PLACES,
    LinkIdentification,
    Recorded,
    identified,
    link_figures,
    recorded_frames,
    scaled_errors,
)

SEED = 40
LINKS = Recorded("chain2", (SEED,), 0.08, 0.08)
SELDOM = replace(LINKS, seldom=True)
ONE_START = LinkIdentification(n_starts=1)


@pytest.fixture(scope="module")
def found():
    return identified(ONE_START, SELDOM, SEED)


def test_the_defaults_are_those_of_the_modules():
    assert LinkIdentification().spread == START_SPREAD


@pytest.mark.parametrize(
    "change",
    [
        {"poke_level": 0.5},
        {"turned": 0.0},
        {"frames_a_period": 1.0},
        {"rigid_share": 0.0},
        {"rigid_sd": 0.1},
        {"screened": 5},
        {"most_passes": 2},
        {"slack": -1e3},
        {"residual_level": 1.0 - 1e-12},
    ],
    ids=str,
)
def test_constants_reach_the_identification(change, found):
    other = identified(replace(ONE_START, **change), SELDOM, SEED)
    assert not np.array_equal(other.cov, found.cov)


def test_the_shortest_step_decides_between_the_filters():
    """Of links of 2,000 N/m, whose stable step is 4.8 ms."""
    network = study._judged(LINKS, SEED).network
    for step_s, linear in ((4e-3, False), (6e-3, True)):
        with constants_in_place(replace(ONE_START, shortest_step_s=step_s), PLACES):
            assert is_linear(network, 1) is linear


def test_starts_and_their_spread_reach_the_identification():
    """Two starts at the same place agree; where hidden nodes are always seen, there is one."""
    near = LinkIdentification(n_starts=2, start_spread=1e-9, start_spread_lengths=1e-9)
    assert identified(near, SELDOM, SEED).n_agreeing == 2
    assert identified(near, LINKS, SEED).n_starts == 1


def test_places_are_those_of_the_record():
    assert set(PLACES) < set(LinkIdentification.__dataclass_fields__)


def test_errors_are_those_of_the_truth(found):
    """Lengths 1 % too long by one standard error: 0.00995 and, by 0.005, 1.99."""
    lengths = [group.kind == "rest_length" for group in found.groups]
    body = study._judged(SELDOM, SEED)
    longer = replace(body.network, rest_lengths=1.01 * body.network.rest_lengths)
    known = replace(found, network=longer, cov=np.diag(np.where(lengths, 0.005**2, 1.0)))
    np.testing.assert_allclose(
        scaled_errors(SELDOM, SEED, known, "rest_length"), np.log(1.01) * np.array([[1, 1], [200, 200]]), rtol=1e-9
    )
    np.testing.assert_allclose(scaled_errors(SELDOM, SEED, known, "stiffness"), 0.0, atol=1e-12)


def test_hidden_joints_are_seen_once_or_always():
    counts = [
        sum(mark.node == "n1" for _, marks in recorded_frames(one, SEED) for mark in marks) for one in (LINKS, SELDOM)
    ]
    assert counts == [8, 1]


def test_figures_are_those_of_the_seeds_in_which_constants_are_found(monkeypatch, found):
    """Of two seeds one fails: half are found, and the errors are the other one's."""

    def only_one(_choices, _recorded, seed):
        if seed == SEED:
            return found
        raise IdentificationError("expected constants, found none")

    monkeypatch.setattr(study, "identified", only_one)
    both = link_figures(ONE_START, {"links": replace(SELDOM, seeds=(SEED, SEED + 1))})
    alone = link_figures(ONE_START, {"links": SELDOM})
    assert (both["links_found"], alone["links_found"]) == (0.5, 1.0)
    assert both["links_lengths"] == alone["links_lengths"] > 0.0
    assert link_figures(ONE_START, {"links": replace(SELDOM, seeds=(SEED + 1,))}) == {
        "links_found": 0.0,
        "links_linearised": 0.0,
    }
