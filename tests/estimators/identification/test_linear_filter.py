"""The linear filter of stiff and large networks: its matrices, its sensitivities, and what it takes for rigid."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm

from dynamics import (
    MassSpringNetwork,
    build_network,
    four_mass_phantom,
    independent_uncertainty,
    parameters,
    scale_parameters,
)
from estimators import FilterSettings, MarkMeasurement
from estimators.identification import linear_filter
from estimators.identification.budget import Budget
from estimators.identification.filter_pass import is_linear, pass_through
from estimators.identification.linear_filter import LinearFilter, quasi_static, rigid_links, transition
from estimators.identification.withheld import withheld_target
from estimators.process.linear_motion import is_linearised
from estimators.process.process_model import TissueModel

SD = 1e-3


def pair():
    """Two masses in a row between two anchors along x, no gravity: exactly linear while they move along x only."""
    return MassSpringNetwork(
        names=("A", "near", "far", "B"),
        positions=np.array([[0.0, 0.0], [0.1, 0.0], [0.2, 0.0], [0.3, 0.0]]),
        masses=np.full(4, 0.2),
        fixed=np.array([True, False, False, True]),
        drag=np.full(4, 0.3),
        friction=np.zeros(4),
        springs=np.array([[0, 1], [1, 2], [2, 3]]),
        stiffness=np.full(3, 40.0),
        rest_lengths=np.full(3, 0.08),
        damping=np.full(3, 0.2),
        gravity=np.zeros(2),
    )


def frames_of(n=12):
    """How long since the frame before [s], and the near mass seen moving along x; next to nothing is seen of y."""
    rng, cov = np.random.default_rng(0), np.diag([SD**2, 1.0])
    places = [0.1 + 3e-3 * np.sin(0.4 * k) + SD * rng.normal() for k in range(n)]
    return [(0.05, [MarkMeasurement("near", [x, 0.0], cov)]) for x in places]


def followed(network, which):
    """Normalised innovations and sensitivities of each frame."""
    uncertainty = independent_uncertainty(which, 0.1)
    linear = LinearFilter(network, ("near",), FilterSettings(), uncertainty, 0.05)
    frames = frames_of()
    linear.start(network.positions, frames[0][1])
    return [linear.advance(dt, marks) for dt, marks in frames[1:]]


def test_transition_and_noise_are_the_textbook_integrals():
    """exp(A t), its integral, and the integral of exp(A s) D exp(A s)', by adaptive quadrature; a stiff matrix."""
    rng = np.random.default_rng(1)
    A = rng.normal(size=(4, 4)) - np.diag([0.0, 1.0, 5.0, 80.0])
    D = np.array([0.0, 1.0, 2.0, 0.5])
    F, integral, noise = transition(A, [D], 0.3)
    np.testing.assert_allclose(F, expm(0.3 * A), rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(integral, quad_vec(lambda s: expm(A * s), 0.0, 0.3)[0], rtol=1e-6, atol=1e-8)
    expected = quad_vec(lambda s: expm(A * s) @ np.diag(D) @ expm(A * s).T, 0.0, 0.3)[0]
    np.testing.assert_allclose(noise, expected, rtol=1e-4, atol=1e-6)


def test_innovations_are_those_of_the_kalman_filter():
    """The pair is linear along x: normalised innovations by the textbook recursion with exp(A dt), to 1e-3."""
    network = pair()
    found = followed(network, ())
    half = network.n_state // 2
    linear = LinearFilter(network, ("near",), FilterSettings(), independent_uncertainty((), 1.0), 0.05)
    frames = frames_of()
    linear.start(network.positions, frames[0][1])
    x, P = linear.x.copy(), linear.P.copy()
    rest = np.r_[network.positions[network.free].ravel(), np.zeros(half)]
    step = linear._linearised(0.05)
    for one, (_, (mark,)) in zip(found, frames[1:], strict=True):
        x = rest + step.F @ (x - rest)
        P = step.F @ P @ step.F.T + step.calm + (step.poked if one.poked else 0.0)
        H = np.eye(network.n_state)[:2]
        S = H @ P @ H.T + mark.cov
        y = mark.position - H @ x
        assert one.y @ one.y == pytest.approx(y @ np.linalg.solve(S, y), rel=1e-3, abs=1e-6)
        density = np.exp(-0.5 * y @ np.linalg.solve(S, y)) / (2.0 * np.pi * np.sqrt(np.linalg.det(S)))
        assert one.log_likelihood == pytest.approx(np.log(density), abs=1e-3)
        K = P @ H.T @ np.linalg.inv(S)
        x, P = x + K @ y, (np.eye(network.n_state) - K @ H) @ P


@pytest.mark.parametrize("small", [True, False])
def test_sensitivities_are_those_of_a_filter_of_other_constants(small, monkeypatch):
    """Innovations of two filters whose constants differ, by the difference; gains differ, too, by next to nothing.

    Of stiffness and rest lengths, within 3 % of the largest: as small networks, exact, and as large ones, by forces.
    """
    if not small:
        monkeypatch.setattr(linear_filter, "MOST_DIFFERENCED", 0)
    network = pair()
    which = [one for one in parameters(network) if one.kind == "rest_length"]
    base = followed(network, which)
    for k in range(len(which)):
        e = 1e-4 * np.eye(len(which))[k]
        moved = followed(scale_parameters(network, which, 0.1 * e), which)
        slope = np.array([(a.y - b.y) / 1e-4 for a, b in zip(base, moved, strict=True)])
        own = np.array([one.T[:, k] for one in base])
        np.testing.assert_allclose(own, slope, rtol=0, atol=0.03 * np.abs(slope).max())


def test_a_large_network_is_followed_as_a_small_one(monkeypatch):
    """Implicit steps and their matrices half way in place of differences: log likelihoods within 0.1 of those."""
    small = followed(pair(), ())
    monkeypatch.setattr(linear_filter, "MOST_DIFFERENCED", 0)
    large = followed(pair(), ())
    np.testing.assert_allclose(
        [one.log_likelihood for one in large], [one.log_likelihood for one in small], rtol=0, atol=0.1
    )


def test_marks_that_leave_nothing_leave_a_covariance():
    """A thousandth of a nanometre: positive to rounding, and what is seen is known as well as it is seen."""
    network = pair()
    linear = LinearFilter(network, ("near",), FilterSettings(), independent_uncertainty((), 1.0), 0.05)
    mark = MarkMeasurement("near", np.array([0.1, 0.0]), 1e-24 * np.eye(2))
    linear.start(network.positions, [mark])
    for _ in range(20):
        linear.advance(0.05, [mark])
        scale = np.sqrt(np.maximum(np.diag(linear.P), 1e-24))
        assert np.linalg.eigvalsh(linear.P / np.outer(scale, scale))[0] > -1e-6
    assert np.diag(linear.P)[:2].max() < 1e-18


def test_led_nodes_are_led_in_every_frame():
    """Shaken by 50 mm: pokes in five frames and more to a filter that knows of no hand, in none to one that does."""
    network, counts = pair(), []
    for led in ((), ("near",)):
        settings = FilterSettings(led_nodes=led)
        linear = LinearFilter(network, ("near",), settings, independent_uncertainty((), 1.0), 0.05)
        linear.start(network.positions, [MarkMeasurement("near", np.array([0.1, 0.0]), SD**2 * np.eye(2))])
        found = [
            linear.advance(0.05, [MarkMeasurement("near", np.array([0.1 + off, 0.0]), SD**2 * np.eye(2))])
            for off in 0.05 * np.sin(0.5 * np.arange(20))
        ]
        counts.append(sum(one.poked for one in found))
    assert counts[0] > 5
    assert counts[1] == 0


def test_a_strain_that_the_filter_considers_beside_is_not_sought():
    """Thirteen masses, many for the tissue filter, not yet for identification: scores of the directions asked for."""
    places = [[0.1 * k, 0.0] for k in range(15)]
    names = ["A", "near", "far", *(f"n{k}" for k in range(3, 14)), "B"]
    springs = [(k, k + 1) for k in range(14)]
    network = build_network(
        names,
        places,
        springs,
        stiffness=40.0,
        masses=0.2,
        damping=0.2,
        gravity=[0.0, 0.0],
        fixed=["A", "B"],
        rest_lengths=[0.08] * 14,
    )
    assert not is_linear(network, 1)
    assert is_linearised(TissueModel(network, ("near",)))
    which = [one for one in parameters(network) if one.kind == "rest_length"]
    uncertainty = independent_uncertainty(which, 0.01)
    frames = [(0.05 * k, marks) for k, (_, marks) in enumerate(frames_of())]
    nodes = (("near",), "far")
    found = pass_through(network, uncertainty, frames, nodes, FilterSettings(), Budget())
    assert found.scores.shape == (len(found.nis), 14)
    assert found.information.shape == (14, 14)
    assert np.linalg.eigvalsh(found.information)[-1] > 0.0
    assert withheld_target(network, uncertainty, frames, nodes).effect.shape == (14, 14)


def test_a_poke_is_noticed_and_only_it():
    """A mark that jumps by 30 standard deviations, after ten that stay."""
    network = pair()
    linear = LinearFilter(network, ("near",), FilterSettings(), independent_uncertainty((), 1.0), 0.05)
    still = [MarkMeasurement("near", [0.1, 0.0], SD**2 * np.eye(2))]
    linear.start(network.positions, still)
    assert not any(linear.advance(0.05, still).poked for _ in range(10))
    assert linear.advance(0.05, [MarkMeasurement("near", [0.13, 0.0], SD**2 * np.eye(2))]).poked


def test_rods_of_a_chain_are_rigid_and_springs_of_a_phantom_are_not(links):
    assert rigid_links(links(), 0.01).all()
    assert not rigid_links(links(), 0.0005).any()
    phantom = four_mass_phantom()
    assert not rigid_links(phantom, 1.0 / 30.0).any()
    np.testing.assert_array_equal(quasi_static(phantom, 1.0 / 30.0).damping, phantom.damping)
    # critical: 2 sqrt(k m), m the reduced mass
    critical = 2.0 * np.sqrt(2000.0 * np.array([0.030, 0.030 * 0.012 / 0.042]))
    np.testing.assert_allclose(quasi_static(links(), 0.01).damping, critical, rtol=1e-12)


def test_stiff_and_large_networks_need_it_and_the_phantom_does_not(links):
    assert is_linear(links(), 1)
    assert not is_linear(four_mass_phantom(), 3)
    soft = replace(links(), stiffness=np.full(2, 10.0), damping=np.full(2, 0.01))
    assert not is_linear(soft, 1)
