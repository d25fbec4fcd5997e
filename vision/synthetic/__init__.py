"""Synthetic frames of known truth: plain ones, and those of a modelled camera with light, blur, noise, clutter.

What may enter: what draws frames for tests and studies. No detector imports it.
"""

from vision.synthetic.camera_frames import (
    Highlight,
    RealCamera,
    RealFrame,
    RealMark,
    Shadow,
    draw_real_frame,
    reflectance,
)
from vision.synthetic.clutter import Hand, Needle, blood_layer, hand_layer, needle_layers, plain_surface
from vision.synthetic.layers import Layer
from vision.synthetic.plain_frames import Disc, Lighting, distractors, draw_frame, paper_camera
from vision.synthetic.runs import Level, RunFrame, drawn_run, exposure_path
from vision.synthetic.sensor import Sensor, light_of, srgb_of
from vision.synthetic.view import DrawnView, tilted_view

__all__ = [
    "Disc",
    "DrawnView",
    "Hand",
    "Highlight",
    "Layer",
    "Level",
    "Lighting",
    "Needle",
    "RealCamera",
    "RealFrame",
    "RealMark",
    "RunFrame",
    "Sensor",
    "Shadow",
    "blood_layer",
    "distractors",
    "draw_frame",
    "draw_real_frame",
    "drawn_run",
    "exposure_path",
    "hand_layer",
    "light_of",
    "needle_layers",
    "paper_camera",
    "plain_surface",
    "reflectance",
    "srgb_of",
    "tilted_view",
]
