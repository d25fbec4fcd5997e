"""Cache of reduced mesh networks in the user's folder, because the reduction takes seconds."""

from __future__ import annotations

import hashlib
import json
import os
import pickle
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

import numpy as np

import dynamics.mesh
from dynamics import MassSpringNetwork
from experiments.errors import InputError
from experiments.formats.outputs import write_whole
from experiments.log import LOG

DIGEST = hashlib.sha256().digest_size
"""Number of bytes of the digest with which a file begins."""


def reduced(key: Mapping[str, object], make: Callable[[], MassSpringNetwork]) -> MassSpringNetwork:
    """The reduced network of a mesh, from the cache. If the cache does not have it, `make` computes it.

    key: all values that determine the network, for JSON
    """
    own = json.dumps([_program(), np.__version__, key])
    path = _cache() / f"{hashlib.sha256(own.encode()).hexdigest()}.pickle"
    try:
        content = path.read_bytes()
    except OSError:
        content = b""
    if content and hashlib.sha256(content[DIGEST:]).digest() == content[:DIGEST]:
        kept: MassSpringNetwork = pickle.loads(content[DIGEST:])
        return kept
    if content:
        LOG.info("%s is incomplete: the mesh is reduced again", path)
    network = make()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        made = pickle.dumps(network)
        write_whole(path, hashlib.sha256(made).digest() + made)
    except (OSError, InputError) as error:
        LOG.info("the reduced mesh cannot be stored: %s", error)
    return network


def _cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path(os.path.expanduser("~")) / ".cache") / "softaim" / "meshes"


@cache
def _program() -> str:
    """SHA-256 of the code that reduces a mesh."""
    root = Path(dynamics.mesh.__file__).parents[1]
    rooms = (root / "mesh", root / "elements", root / "network", Path(__file__).parent)
    files = sorted(file for room in rooms for file in room.glob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
