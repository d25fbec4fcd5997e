"""Synthetic frames with known truth, from plain or realistic camera models.

Detectors must not import code from here.
"""

from vision.synthetic.camera_frames import (
    Highlight,
    Shadow,
    SyntheticCamera,
    SyntheticFrame,
    SyntheticMark,
    draw_synthetic_frame,
    reflectance,
)
from vision.synthetic.clutter import (
    OccludingHand,
    OccludingNeedle,
    blood_layer,
    hand_layer,
    needle_layers,
    plain_surface,
)
from vision.synthetic.layers import Layer
from vision.synthetic.plain_frames import Disc, Lighting, distractors, draw_frame, paper_camera
from vision.synthetic.runs import Level, RunFrame, exposure_path, synthetic_run
from vision.synthetic.sensor import Sensor, light_of, srgb_of
from vision.synthetic.view import SyntheticView, tilted_view

__all__ = [
    "Disc",
    "Highlight",
    "Layer",
    "Level",
    "Lighting",
    "OccludingHand",
    "OccludingNeedle",
    "RunFrame",
    "Sensor",
    "Shadow",
    "SyntheticCamera",
    "SyntheticFrame",
    "SyntheticMark",
    "SyntheticView",
    "blood_layer",
    "distractors",
    "draw_frame",
    "draw_synthetic_frame",
    "exposure_path",
    "hand_layer",
    "light_of",
    "needle_layers",
    "paper_camera",
    "plain_surface",
    "reflectance",
    "srgb_of",
    "synthetic_run",
    "tilted_view",
]
