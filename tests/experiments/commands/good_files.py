"""Good files of every kind, small, for tests that spoil one of them."""

import shutil
from pathlib import Path

import cv2
import numpy as np

from dynamics import four_mass_phantom
from experiments.formats.scene.scene import Mark, Scene, Target, write_scene
from vision import VideoWriter, fronto_parallel_camera

HERE = Path(__file__).parent
SIZE_PX = (64, 48)
PLAN = """version = 1
[needle]
gauge = 16
[entry]
from_mm = [-100.0, 268.0]
to_mm = [100.0, 268.0]
normal = [0.0, 1.0]
n = 5
[[obstacle]]
name = "rib"
centre_mm = [60.0, 240.0]
radius_mm = 6.0
"""
SCENARIO = """version = 1
title = "short"
phantom = "four-mass"
seed = 4
duration_s = 0.2
frame_interval_s = 0.1
[pokes]
nodes = ["M1"]
acceleration_m_s2 = 5.0
shortest_s = 0.1
longest_s = 0.4
pause_s = 1.5
[camera]
size_px = [64, 64]
mm_per_px = [10.0, 10.0]
"""
SWEEP = """version = 1
scenario = "quiet"
seeds = 1
[grid]
scenario.duration_s = [0.2]
marks.sd_mm = [1.0]
"""


ESTIMATES = """time_s,status,x_mm,y_mm,xx,xy,yy,nis,marks_used,poked,gain,model_only
0,INITIALISING,0.5,188,1,0,1,,0,0.1,,False
0.1,TRACKING,1,189,1,0.25,2,0.5,3,0.1,-3,False
0.2,LOST,1,189,100,0,100,,0,0.1,,True
"""
ADVICE = """time_s,advice,reason,arrival_s,p_hit
0,NO_GUIDANCE,"no marks, yet",,
0.1,GO,the target is likely to be hit,0.4,0.97
0.2,NO_GUIDANCE,target lost,,
"""
DEEPLABCUT = """scorer,net,net,net,net,net,net
bodyparts,M1,M1,M1,tail,tail,tail
coords,x,y,likelihood,x,y,likelihood
0,18.25,10.5,0.99,40,30,0.9
1,18.5,10.5,0.5,41,30,0.9
2,19,10.5,0.98,,,
"""
SLEAP = """track,frame_idx,instance.score,M1.x,M1.y,M1.score,M4.x,M4.y,M4.score
,0,0.9,18.25,10.5,0.99,40,30,0.9
,2,0.9,18.5,10.5,0.95,,,
"""

NODES = """name,x_mm,y_mm,mass_kg,fixed,hue_deg,target
A,0,0,0,yes,,
B,100,0,0,yes,,
C,0,60,0.005,,0,
D,100,60,0.005,,120,
E,50,30,0.008,,,yes
"""
SPRINGS = "from,to,stiffness_N_m\nA,C,150\nB,D,150\nA,D,100\nB,C,100\nC,E,50\nD,E,50\nA,E,50\nB,E,50\nC,D,50\n"
SEVERAL = """scorer,net,net,net,net,net,net
individuals,rat,rat,rat,mouse,mouse,mouse
bodyparts,M1,M1,M1,M1,M1,M1
coords,x,y,likelihood,x,y,likelihood
0,18.25,10.5,0.99,40,30,0.9
"""


def write_good_files(folder: Path) -> None:
    """A recording of marks and one of a film, a scene, other inputs, results, a user's own notes."""
    network = four_mass_phantom()
    marks = tuple(Mark(node, 0.0, 0.03, measured=node != "M2") for node in ("M1", "M2", "M3", "M4"))
    scene = Scene(network, marks, Target("M2", 0.005), (fronto_parallel_camera("front", SIZE_PX, (15.0, 15.0)),))
    times = (0.0, 0.1, 0.2)
    frames = "frame,exposure_s\n" + "".join(f"{k},{t}\n" for k, t in enumerate(times))
    places = {node: 1e3 * network.positions[network.index(node)] for node in ("M1", "M2", "M3", "M4")}
    # no two frames alike: values that repeat are those of a tracker that froze
    rows = [f"{t},{node},{x + 0.01 * t:.3f},{y:.3f}" for t in times for node, (x, y) in places.items()]
    for name in ("marks", "film"):
        (folder / name).mkdir()
        write_scene(scene, folder / name / "scene.toml")
        (folder / name / "frames.csv").write_text(frames, encoding="utf-8")
    (folder / "marks" / "marks.csv").write_text(
        "time_s,node,x_mm,y_mm,sd_mm\n" + "".join(f"{row},1.0\n" for row in rows if "M2" not in row), encoding="utf-8"
    )
    (folder / "marks" / "truth.csv").write_text(
        "time_s,node,x_mm,y_mm\n" + "".join(f"{row}\n" for row in rows), encoding="utf-8"
    )
    (folder / "marks" / "fixes.csv").write_text("time_s,x_mm,y_mm,sd_mm\n0.1,0,188,1\n", encoding="utf-8")
    grey = np.full((SIZE_PX[1], SIZE_PX[0], 3), 128, dtype=np.uint8)
    with VideoWriter(folder / "film" / "video.avi", SIZE_PX, 10.0) as film:
        for _ in times:
            film.write(grey)
    (folder / "boards").mkdir()
    cv2.imwrite(str(folder / "boards" / "blank.png"), grey)
    write_scene(scene, folder / "scene.toml")
    shutil.copy(HERE.parent / "needle.toml", folder / "needle.toml")
    (folder / "results").mkdir()
    (folder / "results" / "estimates.csv").write_text(ESTIMATES, encoding="utf-8")
    (folder / "results" / "advice.csv").write_text(ADVICE, encoding="utf-8")
    poses = (("deeplabcut.csv", DEEPLABCUT), ("sleap.csv", SLEAP))
    for name, text in (("plan.toml", PLAN), ("scenario.toml", SCENARIO), ("sweep.toml", SWEEP), *poses):
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "notes").mkdir()
    (folder / "notes" / "mine.txt").write_text("mine", encoding="utf-8")


def tree(folder: Path) -> dict[str, bytes | None]:
    """Everything in a folder: the content of files, None for folders."""
    paths = sorted(folder.rglob("*"))
    return {str(path.relative_to(folder)): None if path.is_dir() else path.read_bytes() for path in paths}
