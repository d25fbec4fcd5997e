"""Reference methods: the paper's open loop, and a spline through the visible marks."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline, RBFInterpolator

from dynamics import MassSpringNetwork, NetworkError
from estimators import OpenLoop
from experiments.arrays import Floats
from experiments.simulation.bodies.body import Body
from experiments.studies.estimation.trials import Frames

FLAT = 1e-3
"""Extent of a body in a direction, relative to its largest extent, up to which it counts as flat in this direction."""


def open_loop(network: MassSpringNetwork, body: Body, frames: Frames) -> Floats | None:
    """Positions of hidden nodes by the paper's method [m], (n_frames, n_hidden, dim); None if it cannot start."""
    try:
        method = OpenLoop(network, body.hidden[0])
    except NetworkError:
        return None
    nodes = [network.index(name) for name in body.hidden]
    places = []
    with np.errstate(all="ignore"):  # if the method diverges, its error is infinite
        for time_s, seen in frames:
            method.update(time_s, seen)
            places.append(method.positions[nodes].copy())
    return np.array(places)


def spline(body: Body, frames: Frames) -> Floats:
    """Positions of hidden nodes by a spline through marks and anchors [m], (n_frames, n_hidden, dim).

    If the nodes are in a line, the spline is cubic along the line. Otherwise a thin-plate spline interpolates the
    displacements from the drawn shape.
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
    """Weights of a thin-plate spline, (n_wanted, n_known); known, wanted: positions of data and results, (n, dim)."""
    center = known.mean(axis=0)
    _, extents, axes = np.linalg.svd(known - center, full_matrices=False)
    kept = axes[extents > FLAT * extents[0]]
    found = RBFInterpolator((known - center) @ kept.T, np.eye(len(known)), kernel="thin_plate_spline")
    return np.asarray(found((wanted - center) @ kept.T))
