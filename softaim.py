"""Estimation of a hidden target in moving soft tissue, with its covariance, and advice for a needle.

The table lists the names to start with; `dynamics`, `estimators` and `vision` have all others. Units are metres,
seconds, kilograms and newtons; arrays have a row for each node or frame.

    build_network         network from names, positions and edges of nodes
    MassSpringNetwork     nodes and springs, checked
    four_mass_phantom     network of the paper's phantom
    fit_rest_lengths      rest lengths of springs from a picture of the network at rest
    rest_shape            positions of a network at rest
    integrate_adaptive    accurate, slow simulation, as ground truth
    pack, unpack          conversion of positions and velocities to state vectors and back
    TissueFilter          filter that predicts, updates and estimates the target
    AssociationFilter     the same filter for marks of one colour
    FilterSettings        assumptions about unknown forces
    MarkMeasurement       measured position of a mark with its covariance
    TargetEstimate        estimated position of the target: mean, covariance, status
    Status                state of the filter: whether an estimate can be trusted
    identify_constants    identification of stiffness, damping, rest lengths from a recording
    tune_strain           estimation of the model's error from a recording
    fixed_interval        smoother
    Lesion, Needle, Insertion    what to hit, with which needle, from where
    hit_probability       probability that a needle at rest hits the lesion
    GaussianMixture       distribution of the target, from TissueFilter.predict_modes
    TargetPoint           target whose place in the tissue is uncertain
    guide                 advice for the needle: go, wait or realign
    open_source           frames from a camera, film, folder or stream
    MarkFinder            detection and tracking of named marks in frames
    PlaneCamera           camera: mapping between pixels and a plane
    Scene, Mark, Target    description of a setup: network, marks, target, cameras
    read_scene, write_scene    scene.toml
    Recording, read_recording    folder of frames or marks with their times
    Result, read_result    output folder of `softaim track`, as pandas DataFrames
    InputError            error of one line for a file that cannot be used

Importing this module loads nothing else; each name is loaded when it is first used.
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
"""Public names by the module that defines them."""

_HOMES = {name: module for module, names in _NAMES_OF.items() for name in names}


if not TYPE_CHECKING:  # with it, a type checker would assume that every name exists

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


if __name__ == "__main__":  # python -m softaim
    from experiments.commands.app import main

    main()
