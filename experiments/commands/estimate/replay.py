"""`softaim replay`."""

from __future__ import annotations

from dataclasses import asdict

from experiments.commands.options import Force, Out, RecordingFolder
from experiments.commands.run import Answer, Run
from experiments.errors import InputError
from experiments.plain import counted


def replay(run: Run, recording: RecordingFolder, out: Out, force: Force = False) -> Answer:
    """Repeat a run recorded by `softaim live --record`, and compare the results bit for bit."""
    from experiments.formats.scene.scene import read_scene
    from experiments.pipeline.live.replaying import replay as replayed

    with run.folder(out, force=force, inputs=[recording]) as folder:
        run.use(read_scene(recording / "scene.toml"))
        done = replayed(recording, folder, run.stage("replay"))
    fault = None
    if done.begun and done.different:
        name, row = next(iter(done.different.items()))
        found = f"a different row {row}: was another version of Softaim used?"
        fault = InputError.at(recording / name, "the rows of the recorded run", found)
    lines = [f"{counted(done.frames, 'frame')} replayed, {done.lacking} of them without a recorded picture"]
    for name, n in done.rows.items():
        same = "the same, bit for bit" if name not in done.different else f"row {done.different[name]} differs"
        lines.append(f"{n} rows of {name}: {same}")
    if not done.begun:
        lines.append("The recording began in the middle of its run: the filter had used earlier frames")
    return Answer({"out": out, **asdict(done)}, [*lines, f"Tables in {out}"], fault)
