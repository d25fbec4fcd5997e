"""Methods with which the filter is compared: the paper's open loop, and a spline through the visible marks."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline, RBFInterpolator

from dynamics import MassSpringNetwork, NetworkError
from estimators import OpenLoop
from experiments.arrays import Floats
from experiments.simulation.bodies.body import Body
from experiments.studies.estimation.trials import Frames

FLAT = 1e-3
"""Largest extent of a body in a direction in which it counts as flat, relative to its largest extent."""


def open_loop(network: MassSpringNetwork, body: Body, frames: Frames) -> Floats | None:
    """Hidden nodes' positions [m], (n_frames, n_hidden, dim), by the paper's method; None without an initial shape."""
    try:
        method = OpenLoop(network, body.hidden[0])
    except NetworkError:
        return None
    nodes = [network.index(name) for name in body.hidden]
    places = []
    with np.errstate(all="ignore"):  # overflow on divergence counts as its error
        for time_s, seen in frames:
            method.update(time_s, seen)
            places.append(method.positions[nodes].copy())
    return np.array(places)


def spline(body: Body, frames: Frames) -> Floats:
    """Hidden nodes' positions by a spline through visible nodes and anchors [m], (n_frames, n_hidden, dim).

    For nodes in a line it is a cubic spline along the length, else a thin-plate spline of the displacement from the
    drawn shape.
    """
    network = body.network
    anchors = np.flatnonzero(network.fixed)
    seen = [network.index(name) for name in body.marked]
    hidden = [network.index(name) for name in body.hidden]
    known = np.r_[anchors, seen]
    fixed = network.positions[anchors]
    places = np.array([np.vstack([fixed, [mark.position for mark in marks]]) for _, marks in frames])
    drawn = network.positions
    if body.in_line:
        along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(drawn, axis=0), axis=1))]
        order = np.argsort(along[known])
        line = CubicSpline(along[known][order], places[:, order], axis=1)
        return np.asarray(line(along[hidden]))
    return drawn[hidden] + thin_plate_weights(drawn[known], drawn[hidden]) @ (places - drawn[known])


def thin_plate_weights(known: Floats, wanted: Floats) -> Floats:
    """Weights, (n_wanted, n_known), with which a thin-plate spline interpolates; known, wanted: positions, (n, dim)."""
    center = known.mean(axis=0)
    _, extents, axes = np.linalg.svd(known - center, full_matrices=False)
    kept = axes[extents > FLAT * extents[0]]
    found = RBFInterpolator((known - center) @ kept.T, np.eye(len(known)), kernel="thin_plate_spline")
    return np.asarray(found((wanted - center) @ kept.T))
