"""Tables of forces in a scenario file."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from experiments.formats.toml_file import Coordinates, NotNegative, Positive, Strict

UPWARD = (0.3, 1.0, 0.0)
"""Default direction of breathing forces; in the plane without the last component."""

Nodes = Annotated[list[str], Field(min_length=1)]


class Tremor(Strict):
    """Tremor of the table: all free nodes have random accelerations, white noise up to `1 / (2 interval_s)` [Hz]."""

    acceleration_m_s2_sqrt_hz: Annotated[float, Field(ge=0)]
    interval_s: Positive = 1.0 / 120.0


class Release(Strict):
    """Initial displacement of one node by a constant force, then its release."""

    node: str
    force_n: Coordinates


class _Forces(Strict):
    """Forces on nodes.

    nodes: nodes on which the forces act; by default, all nodes whose marks the filter uses
    acceleration_m_s2: peak of the strongest poke, or amplitude of breathing, as an acceleration of the nodes
    shortest_s, longest_s: range of the random duration of a poke, or of the random period of breathing
    """

    nodes: Nodes | None = None
    acceleration_m_s2: Positive
    shortest_s: Positive
    longest_s: Positive

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.longest_s < self.shortest_s:
            raise ValueError(f"expected longest_s of at least shortest_s ({self.shortest_s}), found {self.longest_s}")
        return self


class Pokes(_Forces):
    """Pokes by a rod at random times, in random directions. The force of a poke is half a sine wave over time.

    weakest: peak of the weakest poke relative to that of the strongest [1]
    pause_s: mean of the exponentially distributed pause between two pokes
    together: if True, each poke acts on all nodes in the same direction; if False, on one random node
    """

    pause_s: Positive
    weakest: Annotated[float, Field(gt=0, le=1)] = 0.3
    together: bool = False


class Breathing(_Forces):
    """Periodic forces on nodes, like breathing: a sine wave, and a second harmonic with half the amplitude.

    direction: direction of the forces, default `UPWARD`
    If the scene has a mesh and no nodes are stated, the force acts on all parts of the body.
    """

    direction: Coordinates | None = None

    @model_validator(mode="after")
    def _directed(self) -> Breathing:
        if self.direction is not None and not any(self.direction):
            raise ValueError("direction: expected a non-zero vector, found zero")
        return self


class Posture(Strict):
    """Rotation of the body: gravity turns from one direction to another, at a rate that rises and falls.

    from_m_s2: gravity at the start [m/s²]; by default the scene's gravity, under which the body rests as drawn
    """

    from_m_s2: Coordinates | None = None
    to_m_s2: Coordinates
    start_s: NotNegative = 1.0
    lasts_s: Positive = 2.0


class Press(Strict):
    """The force of a probe or a plate that presses on nodes, stays and withdraws.

    force_n: total force, shared equally by all nodes
    lasts_s: duration of the force, including its rise and its fall [s]
    rises_s: duration of the rise [s]; the fall has the same duration
    """

    nodes: Nodes
    force_n: Coordinates
    start_s: NotNegative = 1.0
    lasts_s: Positive = 4.0
    rises_s: Positive = 0.5

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if not any(self.force_n):
            raise ValueError("force_n: expected a non-zero vector, found zero")
        if 2.0 * self.rises_s > self.lasts_s:
            raise ValueError(f"rises_s: expected at most half of lasts_s ({self.lasts_s}), found {self.rises_s}")
        if len(set(self.nodes)) < len(self.nodes):
            raise ValueError("nodes: expected different nodes, found one twice")
        return self
