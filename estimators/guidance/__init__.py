"""Needle guidance: lesion, hit probability, advice, planning, needle tracking, breathing.

Advice based on an estimate belongs here.
"""

from estimators.guidance.abort import AbortWatch
from estimators.guidance.advice import Advice, Guidance, Outlook, PathSource, advise, guide, path_times
from estimators.guidance.breathing import Breath, Breathing, BreathingSettings
from estimators.guidance.contradiction import Contradiction, ContradictionSettings
from estimators.guidance.hit_probability import Aim, best_aim, hit_probability
from estimators.guidance.lesion import Lesion
from estimators.guidance.needle import Hit, Insertion, Needle
from estimators.guidance.needle_tracking import Arrival, NeedleNoise, NeedleTracker
from estimators.guidance.obstacles import Obstacle, ball, clearances
from estimators.guidance.path import (
    PathParts,
    TargetPath,
    breathing_ahead,
    breathing_track,
    either_path,
    path_by_tables,
    path_near_rest,
    path_reach_s,
    path_tables,
)
from estimators.guidance.planning import (
    Plan,
    PlannedNeedle,
    PlannedTarget,
    Skin,
    candidate_paths,
    compliance,
    needle_displacement,
    plan,
)
from estimators.guidance.push import NeedlePush
from estimators.guidance.settings import AdviceSettings, health_fault

__all__ = [
    "AbortWatch",
    "Advice",
    "AdviceSettings",
    "Aim",
    "Arrival",
    "Breath",
    "Breathing",
    "BreathingSettings",
    "Contradiction",
    "ContradictionSettings",
    "Guidance",
    "Hit",
    "Insertion",
    "Lesion",
    "Needle",
    "NeedleNoise",
    "NeedlePush",
    "NeedleTracker",
    "Obstacle",
    "Outlook",
    "PathParts",
    "PathSource",
    "Plan",
    "PlannedNeedle",
    "PlannedTarget",
    "Skin",
    "TargetPath",
    "advise",
    "ball",
    "best_aim",
    "breathing_ahead",
    "breathing_track",
    "candidate_paths",
    "clearances",
    "compliance",
    "either_path",
    "guide",
    "health_fault",
    "hit_probability",
    "needle_displacement",
    "path_by_tables",
    "path_near_rest",
    "path_reach_s",
    "path_tables",
    "path_times",
    "plan",
]
