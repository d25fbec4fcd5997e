"""Splines through the seen marks: exact where they must be."""

import numpy as np
import pytest

from dynamics import NetworkError
from experiments.simulation.bodies.body import Scale
from experiments.simulation.bodies.zoo import make_body
from experiments.studies.zoo import references
from experiments.studies.zoo.constants import measured
from experiments.studies.zoo.references import open_loop, spline, thin_plate_weights


@pytest.mark.parametrize("flat", [False, True])
def test_a_thin_plate_spline_follows_an_affine_motion_exactly(flat):
    rng = np.random.default_rng(7)
    known, wanted = rng.normal(size=(12, 3)), rng.normal(size=(5, 3))
    if flat:
        known[:, 1] = wanted[:, 1] = 0.2
    A, b = rng.normal(size=(3, 3)), rng.normal(size=3)
    weights = thin_plate_weights(known, wanted)
    assert weights @ (known @ A + b) == pytest.approx(wanted @ A + b, abs=1e-9)


def test_one_link_of_two_is_put_on_the_straight_line_to_the_end():
    body = make_body("chain2", 0, seconds=0.1)
    frames = measured(body, body.marked, 0)
    first, second = body.network.rest_lengths
    ends = np.array([marks[0].position for _, marks in frames])
    assert spline(body, frames)[:, 0] == pytest.approx(ends * first / (first + second))


def test_the_open_loop_holds_a_phantom_at_rest_where_it_is():
    """Marks to 0.5 mm: the hidden mass stays within that of where it hangs."""
    body = make_body("phantom", 0, Scale(), seconds=0.2)
    simulated = open_loop(body.network, body, measured(body, body.marked, 0))
    assert simulated is not None
    assert np.linalg.norm(simulated[:, 0] - body.positions[:, 1], axis=1).max() < 5e-4


def test_a_body_without_a_rest_has_no_open_loop(monkeypatch):
    def no_rest(*_):
        raise NetworkError("no rest")

    monkeypatch.setattr(references, "OpenLoop", no_rest)
    body = make_body("chain2", 0, seconds=0.1)
    assert open_loop(body.network, body, measured(body, body.marked, 0)) is None


def test_a_spline_of_a_body_at_rest_leaves_it_there():
    """Before the first pull, within what marks of 0.5 mm an axis make of it."""
    body = make_body("sheet", 0, seconds=0.1)
    found = spline(body, measured(body, body.marked, 0))
    hidden = [body.network.index(name) for name in body.hidden]
    assert np.abs(found - body.positions[:, hidden]).max() < 4.0 * body.mark_sd_m
