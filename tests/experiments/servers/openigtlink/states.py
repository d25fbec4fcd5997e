"""A state of a live run for clients, its scene, and the content of its messages."""

import struct
from typing import Any

from experiments.servers.openigtlink.codec import Message

UTC_S = 1.8e9 + 0.3125
"""In binary fractions, so that no codec has to round it."""
SCENE = {"type": "scene", "dim": 2, "stale_ms": 200}


def status_in(message: Message) -> tuple[int, str]:
    """Code and name of a STATUS."""
    code, _, name = struct.unpack_from(">Hq20s", message.content)
    return code, name.rstrip(b"\0").decode()


def state(**other: Any) -> dict[str, Any]:
    """Of tissue in a plane, tracked, with a needle and advice; `other` in place of these keys."""
    return {
        "type": "state",
        "time_s": 12.5,
        "utc_s": UTC_S,
        "status": "TRACKING",
        "fault": None,
        "paused": False,
        "target_mm": [1.5, -20.25],
        "cov_mm2": [[4.0, 1.0], [1.0, 2.0]],
        "sigma_mm": 2.1,
        "marks_used": 3,
        "nis": 5.5,
        "poked": 0.25,
        "advice": {"advice": "GO", "reason": "a hit is probable", "probability": 0.97},
        "needle": {"tip_mm": [10.0, -50.0], "direction": [0.0, 2.0]},
    } | other
