"""Estimates the place of a hidden target in moving soft tissue, with a covariance, and gives advice for a needle.

These are the names to start with; the packages `dynamics`, `estimators` and `vision` have the others. Lengths
are in metres, times in seconds, masses in kilograms, forces in newtons; arrays have a row for each node or frame.

    build_network         a network from names, positions and edges
    MassSpringNetwork     nodes and springs, checked
    four_mass_phantom     the paper's phantom, a network ready to use
    fit_rest_lengths      rest lengths from a picture of the network at rest
    rest_shape            where a network rests
    integrate_adaptive    slow exact motion, for truths
    pack, unpack          state vectors to and from positions and velocities
    TissueFilter          predict, update, and where the target is
    AssociationFilter     the same for marks that look alike
    FilterSettings        what is assumed about unknown forces
    MarkMeasurement       what goes in: a mark's position and covariance
    TargetEstimate        what comes out: mean, covariance, status
    Status                whether an estimate may be relied upon
    identify_constants    stiffness, damping, rest lengths from a recording
    tune_strain           how far a tissue departs from its model
    fixed_interval        smoothing
    Lesion, Needle, Insertion    what is to be hit, with what, from where
    hit_probability       probability that a needle that stands still hits
    GaussianMixture       the target for it, from TissueFilter.predict_modes
    TargetPoint           a target whose place in the tissue is uncertain
    guide                 go, wait or realign
    open_source           frames from a camera, film, folder or stream
    MarkFinder            marks tracked and named, frame after frame
    PlaneCamera           between pixels and the plane
    Scene, Mark, Target    what is in view: network, marks, target, cameras
    read_scene, write_scene    scene.toml
    Recording, read_recording    a folder of frames or marks with their times
    Result, read_result    a folder that `softaim track` wrote, as pandas DataFrames
    InputError            a file that cannot be used; one line says why

Importing this module loads nothing else; a name is loaded when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynamics import (
        MassSpringNetwork,
        build_network,
        fit_rest_lengths,
        four_mass_phantom,
        integrate_adaptive,
        pack,
        rest_shape,
        unpack,
    )
    from estimators import (
        AssociationFilter,
        FilterSettings,
        GaussianMixture,
        Insertion,
        Lesion,
        MarkMeasurement,
        Needle,
        Status,
        TargetEstimate,
        TargetPoint,
        TissueFilter,
        fixed_interval,
        guide,
        hit_probability,
        identify_constants,
        tune_strain,
    )
    from experiments.errors import InputError
    from experiments.formats.exchange.result_folder import Result, read_result
    from experiments.formats.recording import Recording, read_recording
    from experiments.formats.scene.marks import Mark
    from experiments.formats.scene.scene import Scene, read_scene, write_scene
    from experiments.formats.scene.target import Target
    from vision import MarkFinder, PlaneCamera, open_source

    __version__: str

__all__ = [
    "AssociationFilter",
    "FilterSettings",
    "GaussianMixture",
    "InputError",
    "Insertion",
    "Lesion",
    "Mark",
    "MarkFinder",
    "MarkMeasurement",
    "MassSpringNetwork",
    "Needle",
    "PlaneCamera",
    "Recording",
    "Result",
    "Scene",
    "Status",
    "Target",
    "TargetEstimate",
    "TargetPoint",
    "TissueFilter",
    "__version__",
    "build_network",
    "fit_rest_lengths",
    "fixed_interval",
    "four_mass_phantom",
    "guide",
    "hit_probability",
    "identify_constants",
    "integrate_adaptive",
    "open_source",
    "pack",
    "read_recording",
    "read_result",
    "read_scene",
    "rest_shape",
    "tune_strain",
    "unpack",
    "write_scene",
]

_NAMES_OF = {
    "dynamics": (
        "MassSpringNetwork",
        "build_network",
        "fit_rest_lengths",
        "four_mass_phantom",
        "integrate_adaptive",
        "pack",
        "rest_shape",
        "unpack",
    ),
    "estimators": (
        "AssociationFilter",
        "FilterSettings",
        "GaussianMixture",
        "Insertion",
        "Lesion",
        "MarkMeasurement",
        "Needle",
        "Status",
        "TargetEstimate",
        "TargetPoint",
        "TissueFilter",
        "fixed_interval",
        "guide",
        "hit_probability",
        "identify_constants",
        "tune_strain",
    ),
    "vision": ("MarkFinder", "PlaneCamera", "open_source"),
    "experiments.errors": ("InputError",),
    "experiments.formats.exchange.result_folder": ("Result", "read_result"),
    "experiments.formats.recording": ("Recording", "read_recording"),
    "experiments.formats.scene.marks": ("Mark",),
    "experiments.formats.scene.target": ("Target",),
    "experiments.formats.scene.scene": ("Scene", "read_scene", "write_scene"),
}
"""The public names of each module."""

_HOMES = {name: module for module, names in _NAMES_OF.items() for name in names}


if not TYPE_CHECKING:  # who checks types would take every name to be there

    def __getattr__(name: str) -> Any:
        if name == "__version__":
            from experiments.version import version

            value: Any = version()
        elif name in _HOMES:
            value = getattr(import_module(_HOMES[name]), name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
