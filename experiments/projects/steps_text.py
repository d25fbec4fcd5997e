"""Texts of `STEPS.md`, the page of a new project."""

REAL_FILM = """\
With a real phantom, films replace step 2: calibrate the camera (`softaim calibrate`),
learn the hues of the marks (`softaim hue FILM --at U,V`), write both into `scene.toml`, and record. In `still` and
`calibration` every mark is seen, also the target's; in `rec` the marks inside may be covered.

```sh
softaim record 0 --out still --scene scene.toml --seconds 2
softaim record 0 --out calibration --scene scene.toml --seconds 20
softaim record 0 --out rec --scene scene.toml --seconds 20
```
"""

REAL_MARKS = """\
With a real body, recordings of a tracker replace step 2: folders with `scene.toml` and `marks.csv`
(`time_s,node,x_mm,y_mm,z_mm,sd_mm`). In `rec` only marks on the outside are seen; the other
recordings also have marks inside, measured by CT or ultrasound.
"""

READ_TRUTH = "Only `simulate`, `insert` and `sweep` read `truth/`."

TRUTH_OF_SPRINGS = """\
The constants of `truth/` differ from those of `scene.toml`: stiffnesses by some 10 %, dashpots, drag and friction by
some 20 %, and each spring by a few per cent more. So the simulated tissue, like real tissue, does not rest as drawn.
"""

TRUTH_OF_MESH = """\
The constants of `truth/` differ from those of `scene.toml`: the stiffness of each tissue by some 10 %, its damping by
some 20 %. Both scenes rest as drawn.
"""

CONSTANTS_OF_SPRINGS = """\
Stiffness, dashpots, drag and friction come from a recording with pushes in which the target is seen. Push where the
measured marks are: a push on any other node would look like a wrong constant.
"""

CONSTANTS_OF_MESH = """\
The stiffness of each tissue has a standard error of 30 % at first. The target has to be seen in the recording. Forces
are unknown, so only fast motion shows the stiffness, and weakly. Expect a large standard error. Where the recording
does not determine it, `identified.toml` keeps the value of `scene.toml`. The next steps include this error. No
recording states a known force, such as a weight. If a test of the tissue gives its stiffness, set `young_kpa`.
"""

STEPS = f"""\
# From a scene to advice: <title>

Type these lines in this folder, in this order. They take some minutes in all, and each prints its result.

| file | what it is |
| --- | --- |
| `scene.toml` | your assumptions: the network, its marks, its target <target>. Adapt it to your tissue |
| `needle.toml` | the needle that is advised |
| `truth/scene.toml` | the simulated tissue, to be identified |
| `truth/all_marks.toml` | the same tissue with all marks measured, for calibration |
| `still.toml`, `calibration.toml`, `scenario.toml` | scenarios of simulated recordings |

{READ_TRUTH}

{TRUTH_OF_SPRINGS}
## 1. Check the scene

```sh
softaim check scene.toml --out check
```

Look at `check/check.png`. `missing` lists what the next steps add, and reference marks for a camera that may move.

## 2. Simulate recordings

Each recording is <recorded>, with the truth for scoring.

```sh
softaim simulate still.toml --out still
softaim simulate calibration.toml --out calibration
softaim simulate scenario.toml --out rec
```

<real>
## 3. Identify the rest shape

Rest lengths come from the picture at rest: otherwise the model sags under gravity, and the target's estimate is biased.

```sh
softaim identify still --at-rest --scene scene.toml --out rest.toml
```

## 4. Identify the constants

{CONSTANTS_OF_SPRINGS}
```sh
softaim identify calibration --scene rest.toml --out identified.toml
```

## 5. Tune the noise levels

Tune before advice: if levels are too high, advice waits; if too low, it gives GO too early. Levels are compared by how
well they predict each mark from the others.

```sh
softaim tune rec --scene identified.toml --out tuned.toml
```

## 6. Track the target

```sh
softaim track rec --scene tuned.toml --out track
```

`track/path.png` shows the target's path, true and estimated, with its ellipses.

## 7. Get advice

```sh
softaim advise rec --scene tuned.toml --needle needle.toml --out advice
```

`advice/advice.png` shows when to go, when to wait and when to realign.

Live, on this recording or a camera (`--source 0`):
`softaim live --source rec --scene tuned.toml --needle needle.toml --out live`. Insertions in other runs of the
scenario: `softaim insert scenario.toml --scene tuned.toml --needle needle.toml --runs 20 --out insert`.
"""
