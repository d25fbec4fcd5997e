"""Cache of reduced networks of meshes in the user's folder, because the reduction takes seconds."""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache
from pathlib import Path

import numpy as np

import dynamics.mesh
from dynamics import MassSpringNetwork
from dynamics.network import Continuum
from experiments.errors import InputError
from experiments.formats.outputs import write_whole
from experiments.log import LOG

DIGEST = hashlib.sha256().digest_size


def reduced(key: Mapping[str, object], make: Callable[[], MassSpringNetwork]) -> MassSpringNetwork:
    """The reduced network of a mesh, from the cache. If the cache does not have it, `make` computes it.

    key: all values that determine the network, in JSON types
    """
    path = _cache() / f"{hashlib.sha256(json.dumps([_program(), key]).encode()).hexdigest()}.npz"
    if (kept := _read(path)) is not None:
        return kept
    network = make()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, _content(network))
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


def _content(network: MassSpringNetwork) -> bytes:
    """Content of a cache file: its digest, then its arrays."""
    if network.continuum is None:
        raise ValueError("network: expected a continuum, found none")
    arrays = {f.name: np.asarray(getattr(network, f.name)) for f in fields(network) if f.init and f.name != "continuum"}
    solid = {f"continuum.{f.name}": np.asarray(getattr(network.continuum, f.name)) for f in fields(network.continuum)}
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **arrays, **solid)
    content = file.getvalue()
    return hashlib.sha256(content).digest() + content


def _read(path: Path) -> MassSpringNetwork | None:
    """The network in a cache file; None if it is missing or incomplete."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    if hashlib.sha256(content[DIGEST:]).digest() != content[:DIGEST]:
        LOG.info("%s is incomplete: the mesh is reduced again", path)
        return None
    with np.load(io.BytesIO(content[DIGEST:]), allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    solid = {name.removeprefix("continuum."): value for name, value in arrays.items() if name.startswith("continuum.")}
    own = {name: value for name, value in arrays.items() if "." not in name}
    continuum = Continuum(
        **{
            **solid,
            "tissues": tuple(solid["tissues"].tolist()),
            "mass": float(solid["mass"]),
            "extent_m": float(solid["extent_m"]),
        }
    )
    return MassSpringNetwork(**{**own, "names": tuple(own["names"].tolist()), "continuum": continuum})
